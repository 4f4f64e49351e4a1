#include "model/evaluation/set_sums.h"

namespace maneuver::evaluation {

void SetSums::Add(const Measurement& measured) {
  if (!actions_) actions_.emplace(static_cast<int>(measured.probabilities.size()));
  actions_->Add(measured.probabilities, measured.responsibilities);
  meaning_.Add(measured);
  anchors_.Add(measured);
  ++examples_;
}

void SetSums::Add(const SetSums& other) {
  if (other.examples_ == 0) return;
  if (examples_ == 0) {
    *this = other;
    return;
  }
  actions_->Add(*other.actions_);
  meaning_.Add(other.meaning_);
  anchors_.Add(other.anchors_);
  examples_ += other.examples_;
}

void SetSums::Write(v1::EvaluationReport& report) const {
  auto& metrics = *report.mutable_metrics();
  metrics["effective_actions"] = actions_->EffectiveActions();
  metrics["largest_share"] = actions_->MeanProbability().maxCoeff();
  metrics["action_perplexity"] = actions_->Perplexity();
  metrics["action_entropy"] = actions_->MeanEntropy();
  metrics["mutual_information"] = actions_->MutualInformation();
  metrics["calibration_error"] = actions_->ExpectedCalibrationError();
  meaning_.Write(report);
  anchors_.Write(report);
}

}  // namespace maneuver::evaluation
