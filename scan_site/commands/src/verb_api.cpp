// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/scan/web/scan_web.hpp>
#include <telefab/service/shared_verbs.hpp>

#include "verbs.hpp"

namespace telefab::scan {

VerbBody declare_api(VerbOptions& options) { return telefab::declare_api(options, open_api_json); }

}  // namespace telefab::scan
