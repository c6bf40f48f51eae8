// SPDX-License-Identifier: GPL-3.0-or-later
#include "verbs.hpp"

int main(int argc, char** argv) {
  using namespace telefab::client;
  static constexpr telefab::ProgramText text{
      "telefab", "The operator's client of Telefab: submits scans and follows their jobs.",
      "Examples: telefab submit statue.ply --machine machine-a --height-mm 75 --watch\n"
      "          telefab report j19a-1 --out statue-report\n"};
  static constexpr telefab::Verb verbs[] = {
      {"submit",
       "upload a scan and make it a job",
       declare_submit,
       {{{"scale a scan to 75 mm, print it and follow the job",
          "telefab submit statue.ply --machine machine-a --height-mm 75 --watch"},
         {"a scan in metres at its own size, y up", "telefab submit part.las --machine dlp6500 --units m --up y"}}}},
      {"jobs",
       "list the jobs, newest first",
       declare_jobs,
       {{{"the last ten of a site", "telefab jobs --site chicago --most 10"},
         {"for a script", "telefab jobs --json"}}}},
      {"status",
       "show one job",
       declare_status,
       {{{"where a job is, why it waits, what preflight found", "telefab status j19a-1"}}}},
      {"watch",
       "follow one job until it ends; the exit code tells how",
       declare_watch,
       {{{"until it ends; 0: printed", "telefab watch j19a-1"},
         {"lines instead of a full screen", "telefab watch j19a-1 --plain"}}}},
      {"approve",
       "let a planned job be printed, where the fab asks for it",
       declare_approve,
       {{{"let a job through that preflight holds; your name is kept",
          "telefab approve j19a-1 --site los-angeles --who Ada"}}}},
      {"pause",
       "pause the print after the present layer",
       declare_pause,
       {{{"after the layer that is being exposed", "telefab pause j19a-1 --site los-angeles"}}}},
      {"resume",
       "go on with a paused print",
       declare_resume,
       {{{"go on with the next layer", "telefab resume j19a-1 --site los-angeles"},
         {"after a power cut, where the layer in doubt looks cured",
          "telefab resume j19a-1 --site los-angeles --as exposed"}}}},
      {"cancel", "end a job for good", declare_cancel, {{{"it cannot be taken up again", "telefab cancel j19a-1"}}}},
      {"report",
       "fetch reports and pictures of a job",
       declare_report,
       {{{"pictures, figures and the record of the print", "telefab report j19a-1 --out statue-report"}}}},
      {"machines",
       "list the machines one can print on",
       declare_machines,
       {{{"what the site knows", "telefab machines --site chicago"}}}},
      {"sites",
       "keep names, addresses and certificates of sites",
       declare_sites,
       {{{"keep a site under a name", "telefab sites add chicago --address scan.example.org:7410 --tls telefab-certs"},
         {"then use it", "telefab submit statue.ply --site chicago --machine machine-a --height-mm 75"},
         {"do they answer", "telefab sites check"}}}},
  };
  return telefab::run_program(text, verbs, argc, argv);
}
