#include "model/evaluation/action_matching_text.h"

#include <algorithm>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

namespace maneuver::evaluation {
namespace {

// The actions of one model, in columns of one width.
class MatchedSide {
 public:
  explicit MatchedSide(std::span<const std::string> names) : names_(names) {
    for (const std::string& name : names) width_ = std::max(width_, name.size());
  }

  std::string Title(const char* id) const {
    return absl::StrFormat("%6s  %7s  %-*s", id, "SHARE", Width(), "NAME");
  }
  // "     7    4.1 %  left turn        "
  std::string Text(const v1::MatchedAction& action) const {
    const auto id = static_cast<size_t>(action.action_id());
    return absl::StrFormat("%6d  %5.1f %%  %-*s", action.action_id(), 100.0 * action.share(),
                           Width(), id < names_.size() ? names_[id] : "");
  }
  std::string Blank() const { return std::string(Title("").size(), ' '); }

 private:
  int Width() const { return static_cast<int>(width_); }

  std::span<const std::string> names_;
  size_t width_ = 4;  // of the title
};

std::string Row(const std::string& first, const std::string& distance, const std::string& second) {
  std::string line = absl::StrCat(first, "  ", distance, "  ", second);
  line.erase(line.find_last_not_of(' ') + 1);
  return line + "\n";
}

}  // namespace

std::string ActionMatchingText(const v1::ActionMatching& matching,
                               std::span<const std::string> first_names,
                               std::span<const std::string> second_names) {
  const MatchedSide first(first_names);
  const MatchedSide second(second_names);
  std::string text = Row(first.Title("FIRST"), " APART", second.Title("SECOND"));
  for (const v1::ActionPair& pair : matching.pairs()) {
    text += Row(first.Text(pair.first()), absl::StrFormat("%4.2f m", pair.distance()),
                second.Text(pair.second()));
  }
  for (const v1::MatchedAction& action : matching.unpaired_first()) {
    text += Row(first.Text(action), "     -", second.Blank());
  }
  for (const v1::MatchedAction& action : matching.unpaired_second()) {
    text += Row(first.Blank(), "     -", second.Text(action));
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
