// Tags the targets of one recording by a model.

#ifndef MANEUVER_MODEL_TAGS_TAGGER_H_
#define MANEUVER_MODEL_TAGS_TAGGER_H_

#include <memory>
#include <vector>

#include "maneuver/v1/scenario.pb.h"
#include "maneuver/v1/training_settings.pb.h"
#include "model/data/example_index.h"
#include "model/inference/action_model.h"
#include "model/scene/scene_reader.h"
#include "model/tags/shard_tags.h"

namespace maneuver::tags {

struct TaggerOptions {
  // Settings that choose the windows (data::EnumerateExamples). Complete.
  v1::ExampleSettings examples;
  // Merges consecutive windows of a target with the same action into one row. Windows are
  // consecutive if they are one stride apart.
  bool merged = true;
};

// Not thread-safe: it contains a session and scratch memory. Use one for each thread.
class Tagger {
 public:
  //   model: shared with the tagger, which keeps it alive
  Tagger(std::shared_ptr<const inference::ActionModel> model, TaggerOptions options);

  // Returns the rows of a recording, ordered by target and time. The same recording always has the
  // same rows.
  std::vector<CsvRow> Tag(const v1::Scenario& recording);

 private:
  struct Window;

  std::vector<Window> TagWindows(const v1::Scenario& recording);
  Window TagWindow(const v1::Scenario& recording, const data::Example& example,
                   const inference::SceneEncoding& encoding);
  CsvRow RowOf(const Window* begin, const Window* end) const;

  const std::shared_ptr<const inference::ActionModel> model_;
  const TaggerOptions options_;
  const double stride_;  // seconds
  std::unique_ptr<inference::InferenceSession> session_;
  scene::SceneReader reader_;
  std::vector<scene::SceneInputs> inputs_;
  std::vector<inference::SceneEncoding> encodings_;
};

}  // namespace maneuver::tags

#endif  // MANEUVER_MODEL_TAGS_TAGGER_H_
