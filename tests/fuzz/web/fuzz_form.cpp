// SPDX-License-Identifier: GPL-3.0-or-later
#include <cstdint>
#include <cstdlib>
#include <telefab/web/form_data.hpp>

// The content type up to the first line end, then the body: fields that lie in the body, one behind the other.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace telefab;
  const std::string_view all{reinterpret_cast<const char*>(data), size};
  const std::size_t line = std::min(all.find('\n'), all.size());
  const std::string_view body = all.substr(std::min(line + 1, all.size()));
  const auto fields = form_fields(all.substr(0, line), body);
  if (!fields) {
    if (fields.error().what.empty()) std::abort();
    return 0;
  }
  const char* from = body.data();
  for (const FormField& field : *fields) {
    if (field.content.data() < from || field.content.data() + field.content.size() > body.data() + body.size())
      std::abort();
    from = field.content.data() + field.content.size();
  }
  return 0;
}
