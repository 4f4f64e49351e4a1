#include "model/evaluation/action_matching_text.h"

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

namespace maneuver::evaluation {
namespace {

// Returns "  7   4.1 %  left_turn        ", for example.
std::string Side(const v1::MatchedAction& action) {
  const std::string& name = action.label().empty() ? action.kinematic_class() : action.label();
  return absl::StrFormat("%6d  %5.1f %%  %-17s", action.action_id(), 100.0 * action.share(), name);
}

std::string Blank() { return std::string(34, ' '); }

std::string Row(const std::string& first, const std::string& distance, const std::string& second) {
  std::string line = absl::StrCat(first, "  ", distance, "  ", second);
  line.erase(line.find_last_not_of(' ') + 1);
  return line + "\n";
}

}  // namespace

std::string ActionMatchingText(const v1::ActionMatching& matching) {
  std::string text = absl::StrFormat("%6s  %7s  %-17s  %6s    %6s  %7s  %s\n", "FIRST", "SHARE",
                                     "WHAT", "APART", "SECOND", "SHARE", "WHAT");
  for (const v1::ActionPair& pair : matching.pairs()) {
    text +=
        Row(Side(pair.first()), absl::StrFormat("%4.2f m", pair.distance()), Side(pair.second()));
  }
  for (const v1::MatchedAction& action : matching.unpaired_first()) {
    text += Row(Side(action), "     -", Blank());
  }
  for (const v1::MatchedAction& action : matching.unpaired_second()) {
    text += Row(Blank(), "     -", Side(action));
  }
  absl::StrAppendFormat(&text, "\nmean distance of a pair, by share   %.2f m\n",
                        matching.mean_distance());
  absl::StrAppendFormat(&text, "probability with a partner in %.1f m  %.1f %% and %.1f %%\n",
                        matching.tolerance(), 100.0 * matching.agreeing_share_first(),
                        100.0 * matching.agreeing_share_second());
  if (!matching.has_coincidence()) return text;
  const v1::ActionCoincidence& coincidence = matching.coincidence();
  absl::StrAppendFormat(&text, "examples given to a pair            %.1f %% of %d\n",
                        100.0 * coincidence.paired_share(), coincidence.examples());
  absl::StrAppendFormat(&text, "NMI of the actions of an example    %.3f\n",
                        coincidence.normalized_mutual_information());
  return text;
}

}  // namespace maneuver::evaluation
