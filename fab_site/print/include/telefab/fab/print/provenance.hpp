// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// Keys of PrintRecord::provenance as the daemon fills it; digests are hexadecimal.
namespace telefab::fab::provenance {

inline constexpr const char* kScanName = "scan_name";                ///< file name of the scan, for people
inline constexpr const char* kScan = "scan_sha256";                  ///< of the scan file, as the signed offer names it
inline constexpr const char* kRegistration = "registration_rms_mm";  ///< of the views the scan was put together from
inline constexpr const char* kContours = "contours_sha256";          ///< digest_of(LayerStack) as it arrived
inline constexpr const char* kTransform = "scan_to_build";           ///< sixteen numbers, row-major
inline constexpr const char* kParameters = "parameters";             ///< the job's, JSON
inline constexpr const char* kProfile = "profile_sha256";            ///< machine profile both sites agreed on
inline constexpr const char* kPart = "part_sha256";                  ///< of plan/part.tfc, the contours as planned
inline constexpr const char* kSupports = "supports_sha256";          ///< of plan/supports.json
inline constexpr const char* kSignedBy = "scan_site_key";            ///< Ed25519 public key that signed the offer
inline constexpr const char* kAuditEntries = "audit_entries";  ///< lines of the site's audit log when it was sealed
inline constexpr const char* kAuditHead = "audit_sha256";      ///< of the last of these lines, so of all
inline constexpr const char* kInstance = "instance";           ///< name of the fab's machine that made it last
inline constexpr const char* kSoftware = "software";           ///< program and version

}  // namespace telefab::fab::provenance
