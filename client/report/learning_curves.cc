#include "client/report/learning_curves.h"

#include <algorithm>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_replace.h"

namespace maneuver::report {
namespace {

// A field of CSV as RFC 4180 has it: in quotes where it needs them.
std::string CsvField(const std::string& text) {
  if (text.find_first_of(",\"\r\n") == std::string::npos) return text;
  return absl::StrCat("\"", absl::StrReplaceAll(text, {{"\"", "\"\""}}), "\"");
}

template <typename Figures>
void AppendCsv(const std::string& phase, const v1::JobProgress& epoch, const char* examples,
               const Figures& figures, std::string* csv) {
  const std::map<std::string, double> sorted(figures.begin(), figures.end());
  for (const auto& [term, value] : sorted) {
    absl::StrAppend(csv, CsvField(phase), ",", epoch.epoch(), ",", epoch.step(), ",", examples, ",",
                    CsvField(term), ",", absl::StrFormat("%.9g", value), "\n");
  }
}

}  // namespace

std::vector<LearningPhase> LearningPhases(std::span<const v1::JobProgress> events) {
  std::vector<LearningPhase> phases;
  for (const v1::JobProgress& event : events) {
    if (!event.has_epoch_report()) continue;
    auto phase = std::ranges::find(phases, event.phase(), &LearningPhase::name);
    if (phase == phases.end()) {
      phases.push_back({event.phase(), {}});
      phase = std::prev(phases.end());
    }
    const auto place =
        std::ranges::lower_bound(phase->epochs, event.epoch(), {}, &v1::JobProgress::epoch);
    if (place != phase->epochs.end() && place->epoch() == event.epoch()) {
      *place = event;
    } else {
      phase->epochs.insert(place, event);
    }
  }
  return phases;
}

std::map<std::string, double> MixtureFigures(const v1::EpochReport& epoch) {
  if (epoch.action_usage().empty()) return {};
  return {{"effective_actions", epoch.effective_actions()},
          {"action_perplexity", epoch.action_perplexity()},
          {"mutual_information", epoch.mutual_information()},
          {"smallest_component_stddev", epoch.smallest_component_stddev()},
          {"largest_component_stddev", epoch.largest_component_stddev()}};
}

std::string CurvesCsv(std::span<const LearningPhase> phases) {
  std::string csv = "phase,epoch,step,examples,term,value\n";
  for (const LearningPhase& phase : phases) {
    for (const v1::JobProgress& epoch : phase.epochs) {
      AppendCsv(phase.name, epoch, "training", epoch.epoch_report().training(), &csv);
      AppendCsv(phase.name, epoch, "held-out", epoch.epoch_report().validation(), &csv);
      AppendCsv(phase.name, epoch, "mixture", MixtureFigures(epoch.epoch_report()), &csv);
    }
  }
  return csv;
}

}  // namespace maneuver::report
