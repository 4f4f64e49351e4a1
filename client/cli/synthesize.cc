// maneuver synthesize: recordings of the synthetic town as a dataset folder.

#include <algorithm>
#include <memory>
#include <optional>
#include <ostream>
#include <vector>

#include "absl/strings/str_cat.h"
#include "client/cli/commands.h"
#include "client/cli/interrupt.h"
#include "client/cli/progress_line.h"
#include "client/cli/text_format.h"
#include "model/data/dataset_folder.h"
#include "model/data/town/layouts.h"
#include "model/data/town/synthetic_town.h"
#include "model/machine/ordered_work.h"
#include "model/machine/usable_cores.h"
#include "model/scene/scenario_validation.h"

namespace maneuver::cli {
namespace {

using data::town::TownOptions;
using data::town::TownRecording;

// Recordings 0 .. count-1 of a town, made on several threads and handed out in order. At most a few
// wait for their turn.
class TownProduction {
 public:
  TownProduction(const TownOptions& options, int count, int threads)
      : options_(options), work_(static_cast<size_t>(count), 4 * static_cast<size_t>(threads)) {
    for (int i = 0; i < threads; ++i) work_.Start([this] { Work(); });
  }

  // Returns the next recording; nothing after the last.
  std::optional<TownRecording> Next() { return work_.Take(); }

 private:
  void Work() {
    while (const std::optional<size_t> index = work_.Claim()) {
      work_.Put(*index, data::town::GenerateRecording(options_, static_cast<int>(*index)));
    }
  }

  const TownOptions options_;
  machine::OrderedWork<TownRecording> work_;  // last: its threads end before what they use
};

struct SynthesizeArguments {
  std::string folder;
  int64_t recordings = 200;
  int64_t seed = 1;
  double duration = 20.0;
  int64_t threads = 0;
  std::vector<std::string> layouts;
  std::vector<std::string> without;
};

// Empty: all.
std::vector<std::string> ChosenLayouts(const SynthesizeArguments& arguments) {
  if (arguments.without.empty()) return arguments.layouts;
  std::vector<std::string> layouts = data::town::LayoutNames();
  std::erase_if(layouts, [&](const std::string& layout) {
    return std::ranges::find(arguments.without, layout) != arguments.without.end();
  });
  return layouts;
}

int Synthesize(const SynthesizeArguments& arguments, Environment& environment) {
  if (arguments.without.size() >= data::town::LayoutNames().size() &&
      ChosenLayouts(arguments).empty()) {
    return environment.Refuse("--without: leave at least one kind of place");
  }
  const Interrupt interrupt([] {});  // before the folder, so that Ctrl-C leaves nothing of it
  auto writer = data::DatasetWriter::Create(arguments.folder,
                                            absl::StrCat("synthetic town, seed ", arguments.seed));
  if (!writer.ok()) return environment.FailAt(arguments.folder, writer.status());
  TownOptions options;
  options.seed = static_cast<uint64_t>(arguments.seed);
  options.duration = arguments.duration;
  options.layouts = ChosenLayouts(arguments);
  const int count = static_cast<int>(arguments.recordings);
  const int cores = machine::UsableCores();
  TownProduction production(options, count,
                            arguments.threads > 0 ? static_cast<int>(arguments.threads) : cores);
  ProgressLine progress(environment.errors, environment.progress_form());
  int written = 0;
  while (const std::optional<TownRecording> recording = production.Next()) {
    absl::Status status = (*writer)->Add(recording->scenario);
    for (const v1::ManeuverAnnotation& maneuver : recording->maneuvers) {
      if (status.ok()) status = (*writer)->Add(maneuver);
    }
    if (status.ok() && interrupt.happened()) status = absl::CancelledError("interrupted");
    if (!status.ok()) {
      progress.Clear();
      return environment.FailAt(arguments.folder, status);
    }
    ++written;
    progress.Show(static_cast<double>(written) / count,
                  absl::StrCat(written, " of ", count, " recordings"));
  }
  const absl::StatusOr<v1::Dataset> dataset = (*writer)->Commit();
  progress.Clear();
  if (!dataset.ok()) return environment.FailAt(arguments.folder, dataset.status());
  if (environment.json()) {
    environment.PrintJson(*dataset);
  } else {
    environment.out << arguments.folder << ": " << HowMany(dataset->recordings(), "recording")
                    << ", " << Spell(dataset->duration_seconds()) << " of driving in "
                    << HowMany(dataset->shards_size(), "file") << "\n";
  }
  return kOk;
}

}  // namespace

void AddSynthesize(Command& root, Environment& environment) {
  const auto arguments = std::make_shared<SynthesizeArguments>();
  Command command = root.Add("synthesize", "Make a dataset of the synthetic town",
                             "Writes a new dataset folder with traffic in a made-up town, and with "
                             "labels of what each vehicle\n"
                             "was doing, for evaluation. The same seed gives the same recordings.\n"
                             "Example: maneuver synthesize town --recordings 200 --seed 1\n"
                             "Then:    maneuver dataset upload town town");
  command.Argument("OUT_DIR", &arguments->folder, "Folder to write; must not exist");
  command.Option("--recordings", &arguments->recordings, 1, 1'000'000, "Number of recordings");
  command.Option("--seed", &arguments->seed, 0, INT64_MAX, "Seed of the town and its traffic");
  // Who is there all the time has a state in each frame, and no more than a scenario may have.
  const double longest =
      TownOptions().frame_interval * (scene::ScenarioLimits().max_states_per_agent - 1);
  command.Option("--duration", &arguments->duration, 2.0, longest, "Seconds of each recording");
  const std::vector<std::string> layouts = data::town::LayoutNames();
  command.Choices("--layout", &arguments->layouts, layouts,
                  "Kind of place to make recordings of; may be repeated [all]");
  command.Choices("--without", &arguments->without, layouts,
                  "Kind of place to leave out; may be repeated");
  command.Exclude("--layout", "--without");
  command.Option("--threads", &arguments->threads, 0, 1'024, "Threads; 0: one for each core");
  command.Run([arguments, &environment] { return Synthesize(*arguments, environment); });
}

}  // namespace maneuver::cli
