#include "verbs.hpp"

int main(int argc, char** argv) {
  using namespace telefab::cli;
  static constexpr telefab::ProgramText text{
      "telefab", "The operator's client of Telefab: submits scans and follows their jobs.",
      "Examples: telefab submit statue.ply --machine machine-a --height-mm 75 --watch\n"
      "          telefab report j19a-1 --out statue-report\n"};
  static constexpr telefab::Verb verbs[] = {
      {"submit", "upload a scan and make it a job", declare_submit},
      {"jobs", "list the jobs, newest first", declare_jobs},
      {"status", "show one job", declare_status},
      {"watch", "follow one job until it ends; the exit code tells how", declare_watch},
      {"approve", "let a planned job be printed, where the fab asks for it", declare_approve},
      {"pause", "pause the print after the present layer", declare_pause},
      {"resume", "go on with a paused print", declare_resume},
      {"cancel", "end a job for good", declare_cancel},
      {"report", "fetch reports and pictures of a job", declare_report},
      {"machines", "list the machines one can print on", declare_machines},
      {"sites", "keep names, addresses and certificates of sites", declare_sites},
  };
  return telefab::run_program(text, verbs, argc, argv);
}
