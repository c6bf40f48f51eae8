// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/service/shared_verbs.hpp>

#include "verbs.hpp"

int main(int argc, char** argv) {
  using namespace telefab::scan;
  static constexpr telefab::ProgramText text{
      "telefab-scan", "The scan site of Telefab: turns scans into layer contours and sends them to the fab site.",
      "Example: telefab-scan slice statue.ply --machine machine-a --height-mm 75 --out statue.tfc --preview "
      "statue.png\n"};
  static constexpr telefab::Verb verbs[] = {
      {"serve",
       "take scans from clients, slice them and send the layers to the fab",
       declare_serve,
       {{{"beside a fab daemon on the same computer", "telefab-scan serve --fab 127.0.0.1:7420 --data scan-data"},
         {"over the net, with certificates and a web page",
          "telefab-scan serve --listen 0.0.0.0:7410 --fab fab.example.org:7420 --tls certs --data scan-data --web "
          "127.0.0.1:7481"}}}},
      {"logs",
       "what happened to one job here",
       telefab::declare_logs,
       {{{"what happened, and what goes on", "telefab-scan logs j19a-1 --data scan-data --follow"}}}},
      {"audit",
       "follow the audit log through all of its parts; exit code 4 if it was changed",
       telefab::declare_audit,
       {{{"from the first line to the last", "telefab-scan audit --data scan-data"}}}},
      {"tokens",
       "the tokens that operators sign in with at the page",
       telefab::declare_tokens,
       {{{"let somebody in at the page, by name", "telefab-scan tokens add ada --data scan-data"},
         {"let her in no more", "telefab-scan tokens revoke ada --data scan-data"}}}},
      {"register",
       "join the range images of a turntable to one cloud",
       declare_register,
       {{{"twelve views of a turntable, 30 degrees apart",
          "telefab-scan register views --step-deg 30 --upright --out statue.ply"},
         {"views whose poses are known",
          "telefab-scan register views --poses poses.conf --out statue.ply --picture statue.png"}}}},
      {"clean",
       "remove outliers, small clusters and noise from a cloud",
       declare_clean,
       {{{"remove what is surely wrong", "telefab-scan clean raw.ply --out statue.ply --picture removed.png"},
         {"a noisy scan", "telefab-scan clean raw.ply --preset strong --out statue.ply"}}}},
      {"slice",
       "cut a scan into layers of contours",
       declare_slice,
       {{{"contours for a machine, and a picture to look at",
          "telefab-scan slice statue.ply --machine machine-a --height-mm 75 --out statue.tfc --preview statue.png"},
         {"as large as the machine holds; fail if a layer is not certified",
          "telefab-scan slice statue.ply --machine machine-a --fit --out statue.tfc --require-certified"},
         {"some layers as JSON lines",
          "telefab-scan slice statue.ply --machine machine-a --height-mm 75 --layers 100:120 --contours some.jsonl"}}}},
      {"inspect",
       "show where contours begin, end, part and join",
       declare_inspect,
       {{{"critical points, holes and handles, with a picture",
          "telefab-scan inspect statue.ply --out-prefix statue"}}}},
      {"digitize",
       "make virtual range images of a mesh",
       declare_digitize,
       {{{"a knot without a scanner, to try things out",
          "telefab-scan digitize --shape knot --height-mm 40 --noise-mm 0.05 --out views --reference knot.ply"},
         {"a mesh on a turntable, seen from above and below",
          "telefab-scan digitize statue.stl --step-deg 30 --tilt-deg 30,-30 --out views"}}}},
      {"measure",
       "compare a built part with its reference",
       declare_measure,
       {{{"how far a printed part is from the scan",
          "telefab-scan measure statue.ply printed.ply --picture deviation.png --report deviation.json"}}}},
      {"machines",
       "list the machine profiles",
       telefab::declare_machines,
       {{{"every key of a profile, its range and why", "telefab-scan machines --keys"}}}},
  };
  return telefab::run_program(text, verbs, argc, argv);
}
