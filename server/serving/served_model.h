// A model version in memory, and the engines that evaluate it.

#ifndef MANEUVER_SERVER_SERVING_SERVED_MODEL_H_
#define MANEUVER_SERVER_SERVING_SERVED_MODEL_H_

#include <chrono>
#include <cstddef>
#include <deque>
#include <memory>
#include <string>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "locks/mutex.h"
#include "model/inference/action_model.h"
#include "model/scene/scene_reader.h"
#include "server/security/resource_name.h"

namespace maneuver::serving {

// What one worker needs to answer for a batch of targets. Used by one thread at a time.
class Engine {
 public:
  explicit Engine(const inference::ActionModel& model);

  scene::SceneReader& reader() { return reader_; }
  inference::InferenceSession& session() { return *session_; }
  // Returns where the inputs of a batch's target `i` are read to. The reference stays valid when
  // others are asked for.
  scene::SceneInputs& Inputs(size_t i);

 private:
  scene::SceneReader reader_;
  std::unique_ptr<inference::InferenceSession> session_;
  std::deque<scene::SceneInputs> inputs_;
};

// Everything that a request in flight holds on to: while it does, the version stays in memory,
// whatever the registry serves meanwhile. Safe to share between threads.
class ServedModel {
 public:
  ServedModel(security::ModelVersionName name, std::shared_ptr<const inference::ActionModel> model);

  const security::ModelVersionName& name() const { return name_; }
  const inference::ActionModel& model() const { return *model_; }

  // Display names of the actions, by id. [K]
  using ActionNames = std::shared_ptr<const std::vector<std::string>>;
  ActionNames action_names() const;
  // Replaces them, as when an action has been labelled. Calls in flight keep those that they have.
  void SetActionNames(std::vector<std::string> names);

  // Evaluates an empty scene, so that a model which cannot answer is found before anyone asks it,
  // and so that the first request is as fast as the next. INTERNAL with what is wrong.
  absl::Status WarmUp();

  // An engine that is idle, or a new one: there are never more than threads that lease at once.
  class Lease {
   public:
    explicit Lease(ServedModel& model) : model_(model), engine_(model.TakeEngine()) {}
    ~Lease() { model_.ReturnEngine(std::move(engine_)); }
    Lease(const Lease&) = delete;
    Lease& operator=(const Lease&) = delete;
    Engine& operator*() { return *engine_; }
    Engine* operator->() { return engine_.get(); }

   private:
    ServedModel& model_;
    std::unique_ptr<Engine> engine_;
  };

 private:
  std::unique_ptr<Engine> TakeEngine();
  void ReturnEngine(std::unique_ptr<Engine> engine);

  const security::ModelVersionName name_;
  const std::shared_ptr<const inference::ActionModel> model_;
  mutable Mutex mutex_;
  std::vector<std::unique_ptr<Engine>> idle_ ABSL_GUARDED_BY(mutex_);
  ActionNames action_names_ ABSL_GUARDED_BY(mutex_);
};

using ModelHandle = std::shared_ptr<ServedModel>;

}  // namespace maneuver::serving

#endif  // MANEUVER_SERVER_SERVING_SERVED_MODEL_H_
