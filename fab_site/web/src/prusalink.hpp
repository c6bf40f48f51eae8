// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/fab/web/page_backend.hpp>
#include <telefab/web/web_message.hpp>

// PrusaLink's API of version 1 (Prusa-Link-Web, spec/openapi.yaml), as far as programs use it that send files to a
// printer and watch it. Its one storage "local" (also "usb", for programs that know no other) holds the fab's jobs as
// files: the name in a path is the file's, and means the newest job of that name, or a job's id; folders are not kept.
// Its job is the one being printed or paused.
namespace telefab::fab {

/// A file as its address names it.
struct FileAddress {
  std::string_view storage;
  std::string_view path;  ///< below the storage, percent signs read
};

/// {"title":...,"message":...}
[[nodiscard]] WebResponse prusalink_problem(unsigned status, std::string_view what);

[[nodiscard]] WebResponse prusalink_info(const WebRequest& request);
[[nodiscard]] WebResponse prusalink_status(PageBackend& backend);
[[nodiscard]] WebResponse prusalink_storage(PageBackend& backend);
/// 204 where nothing is printed.
[[nodiscard]] WebResponse prusalink_job(PageBackend& backend);
/// `number` names the job as prusalink_job does. 204; 404 where that is not being printed, 409 where its state does not
/// allow it.
[[nodiscard]] WebResponse prusalink_command(PageBackend& backend, std::string_view number, JobCommand command,
                                            std::string_view who);

/// Here and below 404 for another storage.
[[nodiscard]] WebResponse prusalink_files(PageBackend& backend, std::string_view storage);
[[nodiscard]] WebResponse prusalink_file(PageBackend& backend, const FileAddress& file);
/// Makes a job of the body: 201. Where Print-After-Upload is ?1 it is printed as soon as it is planned and nothing
/// holds it, else it waits for approval. Where Overwrite is not ?1, a name that is there is refused with 409; jobs of
/// that name stay in any case.
[[nodiscard]] WebResponse prusalink_upload(const WebRequest& request, PageBackend& backend, const FileAddress& file,
                                           std::string_view who);
/// Approves the job of a file, as far as nothing holds it: 204, 404, 409.
[[nodiscard]] WebResponse prusalink_start(PageBackend& backend, const FileAddress& file, std::string_view who);
/// Cancels and forgets the job of a file: 204, 404; 409 where it is being printed, or still worked on.
[[nodiscard]] WebResponse prusalink_delete(PageBackend& backend, const FileAddress& file, std::string_view who);

}  // namespace telefab::fab
