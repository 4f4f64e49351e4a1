// A model version in memory, and the engines that evaluate it.

#ifndef MANEUVER_SERVER_SERVING_SERVED_MODEL_H_
#define MANEUVER_SERVER_SERVING_SERVED_MODEL_H_

#include <chrono>
#include <cstddef>
#include <deque>
#include <exception>
#include <memory>
#include <string>
#include <utility>
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
  // Returns the place for the inputs of target `i` of a batch. The reference stays valid when other
  // targets are requested.
  scene::SceneInputs& Inputs(size_t i);

 private:
  scene::SceneReader reader_;
  std::unique_ptr<inference::InferenceSession> session_;
  std::deque<scene::SceneInputs> inputs_;
};

// A version in memory. A request in progress holds a handle, so its version stays in memory even if
// another version serves meanwhile. Safe to share between threads.
class ServedModel {
 public:
  ServedModel(security::ModelVersionName name, std::shared_ptr<const inference::ActionModel> model);

  const security::ModelVersionName& name() const { return name_; }
  const inference::ActionModel& model() const { return *model_; }

  // Display names of the actions, by id. [K]
  using ActionNames = std::shared_ptr<const std::vector<std::string>>;
  ActionNames action_names() const;
  // Replaces the names, for example when an action has been labelled. Calls in progress keep the
  // old names.
  void SetActionNames(std::vector<std::string> names);

  // Evaluates an empty scene. This finds a model that cannot answer before it serves, and makes the
  // first request as fast as later ones. INTERNAL says what is wrong.
  absl::Status WarmUp();

  // Borrows an engine at its first use, an idle or else a new one. So there are never more engines
  // than threads that held one at the same time.
  class Lease {
   public:
    explicit Lease(ServedModel& model) : model_(model) {}
    ~Lease() {
      if (engine_ != nullptr) model_.ReturnEngine(std::move(engine_));
    }
    Lease(const Lease&) = delete;
    Lease& operator=(const Lease&) = delete;

    // Calls `use` with the engine. INTERNAL, reason ENGINE_FAILED, if that throws, as libraries do
    // (dnnl::error, std::bad_alloc). The engine is then given up, with all that it has read, and
    // the next use has another.
    template <typename Use>
    absl::Status With(const Use& use) {
      try {
        if (engine_ == nullptr) engine_ = model_.TakeEngine();
        use(*engine_);
        return absl::OkStatus();
      } catch (const std::exception& error) {
        engine_ = nullptr;
        return EngineFailed(model_.name(), error);
      }
    }

   private:
    ServedModel& model_;
    std::unique_ptr<Engine> engine_;
  };

 private:
  static absl::Status EngineFailed(const security::ModelVersionName& name,
                                   const std::exception& error);
  absl::Status CheckEmptyScene(Engine& engine) const;
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
