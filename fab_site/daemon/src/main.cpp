#include <telefab/desk/shared_verbs.hpp>

#include "verbs.hpp"

int main(int argc, char** argv) {
  using namespace telefab::fab;
  static constexpr telefab::ProgramText text{
      "telefab-fab",
      "The fab site of Telefab: plans supports, masks and exposures from layer contours, and prints them.",
      "Example: telefab-fab plan statue.tfc --machine machine-a --out statue-plan\n"};
  static constexpr telefab::Verb verbs[] = {
      {"plan", "supports, masks and exposures of a contour file, into a folder", declare_plan},
      {"export", "a plan or contours in the formats of other printers and programs", declare_export},
      {"import", "contours made elsewhere, as a contour file for a machine", declare_import},
      {"serve", "take layers from scan sites, plan and print them", declare_serve},
      {"logs", "what happened to one job here", telefab::declare_logs},
      {"verify", "prove on a plan's masks that nothing floats; exit code 8 if something does", declare_verify},
      {"predict", "the part that a plan's masks and exposures will cure, against its contours", declare_predict},
      {"supports", "figures and pictures of a contour file's supports, without masks", declare_supports},
      {"calibrate", "test masks, and the profile's optics and resin from what was measured", declare_calibrate},
      {"cover", "place the fewest anchors that hold given regions", declare_cover},
      {"machines", "list the machine profiles", telefab::declare_machines},
      {"probe", "ask the machine's devices who they are, LEDs off", declare_probe},
      {"simulate-usb", "offer a simulated projector and stage over USB/IP", declare_simulate_usb},
  };
  return telefab::run_program(text, verbs, argc, argv);
}
