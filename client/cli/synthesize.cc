// maneuver synthesize: recordings of the synthetic town as a dataset folder.

#include <algorithm>
#include <condition_variable>
#include <map>
#include <memory>
#include <mutex>
#include <ostream>
#include <thread>
#include <vector>

#include "absl/strings/str_cat.h"
#include "client/cli/commands.h"
#include "client/cli/progress_line.h"
#include "client/cli/text_format.h"
#include "model/data/dataset_folder.h"
#include "model/data/town/synthetic_town.h"
#include "model/machine/usable_cores.h"

namespace maneuver::cli {
namespace {

using data::town::TownOptions;
using data::town::TownRecording;

// Recordings 0 .. count-1 of a town, made on several threads and handed out in order. At most a few
// wait for their turn.
class TownProduction {
 public:
  TownProduction(const TownOptions& options, int count, int threads)
      : options_(options), count_(count), most_ahead_(4 * threads) {
    for (int i = 0; i < threads; ++i) workers_.emplace_back([this] { Work(); });
  }

  ~TownProduction() {
    {
      const std::lock_guard lock(mutex_);
      stopped_ = true;
    }
    changed_.notify_all();
    for (std::thread& worker : workers_) worker.join();
  }

  // The next recording; call it `count` times.
  TownRecording Next() {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [this] { return finished_.count(handed_out_) > 0; });
    TownRecording recording = std::move(finished_.extract(handed_out_++).mapped());
    changed_.notify_all();
    return recording;
  }

 private:
  void Work() {
    std::unique_lock lock(mutex_);
    while (true) {
      changed_.wait(lock, [this] {
        return stopped_ || begun_ == count_ || begun_ < handed_out_ + most_ahead_;
      });
      if (stopped_ || begun_ == count_) return;
      const int index = begun_++;
      lock.unlock();
      TownRecording recording = data::town::GenerateRecording(options_, index);
      lock.lock();
      finished_.emplace(index, std::move(recording));
      changed_.notify_all();
    }
  }

  const TownOptions options_;
  const int count_;
  const int most_ahead_;
  std::mutex mutex_;  // protects all below
  std::condition_variable changed_;
  std::map<int, TownRecording> finished_;
  int begun_ = 0;
  int handed_out_ = 0;
  bool stopped_ = false;
  std::vector<std::thread> workers_;
};

struct SynthesizeArguments {
  std::string folder;
  int64_t recordings = 200;
  int64_t seed = 1;
  double duration = 20.0;
  int64_t threads = 0;
};

int Synthesize(const SynthesizeArguments& arguments, Environment& environment) {
  auto writer = data::DatasetWriter::Create(arguments.folder,
                                            absl::StrCat("synthetic town, seed ", arguments.seed));
  if (!writer.ok()) return environment.FailAt(arguments.folder, writer.status());
  TownOptions options;
  options.seed = static_cast<uint64_t>(arguments.seed);
  options.duration = arguments.duration;
  const int count = static_cast<int>(arguments.recordings);
  const int cores = machine::UsableCores();
  TownProduction production(options, count,
                            arguments.threads > 0 ? static_cast<int>(arguments.threads) : cores);
  ProgressLine progress(environment.errors, environment.progress_form());
  for (int i = 0; i < count; ++i) {
    const TownRecording recording = production.Next();
    absl::Status status = (*writer)->Add(recording.scenario);
    for (const v1::ManeuverAnnotation& maneuver : recording.maneuvers) {
      if (status.ok()) status = (*writer)->Add(maneuver);
    }
    if (!status.ok()) return environment.FailAt(arguments.folder, status);
    progress.Show((i + 1.0) / count, absl::StrCat(i + 1, " of ", count, " recordings"));
  }
  const absl::StatusOr<v1::Dataset> dataset = (*writer)->Commit();
  progress.Clear();
  if (!dataset.ok()) return environment.FailAt(arguments.folder, dataset.status());
  if (environment.json()) {
    environment.PrintJson(*dataset);
  } else {
    environment.out << arguments.folder << ": " << dataset->recordings() << " recordings, "
                    << Spell(dataset->duration_seconds()) << " of driving in "
                    << dataset->shards_size() << " files\n";
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
  command.Option("--duration", &arguments->duration, 2.0, 600.0, "Seconds of each recording");
  command.Option("--threads", &arguments->threads, 0, 1'024, "Threads; 0: one for each core");
  command.Run([arguments, &environment] { return Synthesize(*arguments, environment); });
}

}  // namespace maneuver::cli
