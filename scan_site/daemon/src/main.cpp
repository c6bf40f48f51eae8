#include <telefab/desk/shared_verbs.hpp>

#include "verbs.hpp"

int main(int argc, char** argv) {
  using namespace telefab::scan;
  static constexpr telefab::ProgramText text{
      "telefab-scan", "The scan site of Telefab: turns scans into layer contours and sends them to the fab site.",
      "Example: telefab-scan slice statue.ply --machine machine-a --height-mm 75 --out statue.tfc --preview "
      "statue.png\n"};
  static constexpr telefab::Verb verbs[] = {
      {"serve", "take scans from clients, slice them and send the layers to the fab", declare_serve},
      {"logs", "what happened to one job here", telefab::declare_logs},
      {"register", "join the range images of a turntable to one cloud", declare_register},
      {"clean", "remove outliers, small clusters and noise from a cloud", declare_clean},
      {"slice", "cut a scan into layers of contours", declare_slice},
      {"inspect", "show where contours begin, end, part and join", declare_inspect},
      {"digitize", "make virtual range images of a mesh", declare_digitize},
      {"measure", "compare a built part with its reference", declare_measure},
      {"machines", "list the machine profiles", telefab::declare_machines},
  };
  return telefab::run_program(text, verbs, argc, argv);
}
