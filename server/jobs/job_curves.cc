#include "server/jobs/job_curves.h"

#include <limits>
#include <string>

namespace maneuver::jobs {
namespace {

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

double Find(const google::protobuf::Map<std::string, double>& means, const char* name) {
  const auto found = means.find(name);
  return found == means.end() ? kNone : found->second;
}

}  // namespace

JobCurves::JobCurves(monitoring::MetricRegistry& metrics, int slots) {
  for (int slot = 0; slot < slots; ++slot) {
    const std::string number = std::to_string(slot + 1);
    const auto gauge = [&](const char* name, const char* help) -> monitoring::Gauge& {
      return metrics.AddGauge(name, help, {{"slot", number}});
    };
    const auto loss = [&](const char* of) -> monitoring::Gauge& {
      return metrics.AddGauge("maneuver_training_loss_nats",
                              "Mean loss of an example in the last epoch of the job that runs in "
                              "the slot; phases have losses of their own.",
                              {{"slot", number}, {"of", of}});
    };
    slots_.push_back(
        {.fraction = gauge("maneuver_job_fraction",
                           "How far the job is that runs in the slot, 0 to 1; NaN: none runs."),
         .examples_per_second = gauge("maneuver_training_examples_per_second",
                                      "Examples learned from by the job in the slot."),
         .training_loss = loss("training"),
         .validation_loss = loss("validation"),
         .log_likelihood = gauge("maneuver_training_log_likelihood_nats",
                                 "Mean log-likelihood of a waypoint on validation examples, of the "
                                 "last epoch of the job in the slot."),
         .effective_actions = gauge("maneuver_training_effective_actions",
                                    "Actions in use after the last epoch of the job in the "
                                    "slot.")});
    Clear(slot);
  }
}

void JobCurves::Show(int slot, const v1::JobProgress& progress) {
  Slot& shown = slots_.at(static_cast<size_t>(slot));
  shown.fraction.Set(progress.fraction());
  if (progress.examples_per_second() > 0.0) {
    shown.examples_per_second.Set(progress.examples_per_second());
  }
  if (!progress.has_epoch_report()) return;
  const v1::EpochReport& epoch = progress.epoch_report();
  shown.training_loss.Set(Find(epoch.training(), "loss"));
  shown.validation_loss.Set(Find(epoch.validation(), "loss"));
  shown.log_likelihood.Set(Find(epoch.validation(), "log_likelihood"));
  // There are none before there is a mixture.
  shown.effective_actions.Set(epoch.action_usage().empty() ? kNone : epoch.effective_actions());
}

void JobCurves::Clear(int slot) {
  const Slot& shown = slots_.at(static_cast<size_t>(slot));
  for (monitoring::Gauge* gauge :
       {&shown.fraction, &shown.examples_per_second, &shown.training_loss, &shown.validation_loss,
        &shown.log_likelihood, &shown.effective_actions}) {
    gauge->Set(kNone);
  }
}

}  // namespace maneuver::jobs
