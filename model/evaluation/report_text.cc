#include "model/evaluation/report_text.h"

#include <algorithm>
#include <map>
#include <set>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/string_view.h"
#include "model/evaluation/gaussian_shares.h"
#include "model/evaluation/rival_text.h"
#include "model/evaluation/text_block.h"

namespace maneuver::evaluation {
namespace {

using Metrics = google::protobuf::Map<std::string, double>;
using Format = std::string (*)(double value);

std::string Hundredths(double value) { return absl::StrFormat("%.2f", value); }
std::string Thousandths(double value) { return absl::StrFormat("%.3f", value); }
std::string Share(double value) { return absl::StrFormat("%.1f %%", 100.0 * value); }
std::string Count(double value) { return absl::StrFormat("%.0f", value); }

// Takes metrics out of a report by name and keeps those that are left.
class Reader {
 public:
  explicit Reader(const Metrics& metrics) : metrics_(metrics) {}

  // Returns an empty text if the metric is absent.
  std::string Read(const std::string& name, Format format) {
    const auto found = metrics_.find(name);
    if (found == metrics_.end()) return "";
    read_.insert(name);
    return format(found->second);
  }

  // Adds a row of metrics unless all of them are absent.
  void Row(Block& block, std::string label, Format format, const std::vector<std::string>& names) {
    std::vector<std::string> values;
    bool any = false;
    for (const std::string& name : names) {
      values.push_back(Read(name, format));
      any = any || !values.back().empty();
    }
    if (any) block.Add(std::move(label), std::move(values));
  }

  std::map<std::string, double> Left() const {
    std::map<std::string, double> left;
    for (const auto& [name, value] : metrics_) {
      if (read_.count(name) == 0) left[name] = value;
    }
    return left;
  }

 private:
  const Metrics& metrics_;
  std::set<std::string> read_;
};

constexpr size_t kModelColumns = 4;  // k = 1, 5, 6, 10; then the baselines that learn nothing

// Returns ade_1, min_ade_5, min_ade_6, min_ade_10, ade_cv, ade_ctra, ade_faded for "ade".
std::vector<std::string> Best(absl::string_view error) {
  return {absl::StrCat(error, "_1"),         absl::StrCat("min_", error, "_5"),
          absl::StrCat("min_", error, "_6"), absl::StrCat("min_", error, "_10"),
          absl::StrCat(error, "_cv"),        absl::StrCat(error, "_ctra"),
          absl::StrCat(error, "_faded")};
}

std::vector<std::string> Each(absl::string_view error) {
  return {absl::StrCat(error, "_1"),    absl::StrCat(error, "_5"),  absl::StrCat(error, "_6"),
          absl::StrCat(error, "_10"),   absl::StrCat(error, "_cv"), absl::StrCat(error, "_ctra"),
          absl::StrCat(error, "_faded")};
}

// Returns ade_medoid, min_ade_cover_5, min_ade_cover_6, min_ade_cover_10 for "ade" and "min_".
std::vector<std::string> Cover(absl::string_view error, absl::string_view best) {
  return {absl::StrCat(error, "_medoid"), absl::StrCat(best, error, "_cover_5"),
          absl::StrCat(best, error, "_cover_6"), absl::StrCat(best, error, "_cover_10")};
}

// Appends "_prior" to each name. Baselines have no latent, so theirs are left out.
std::vector<std::string> Prior(std::vector<std::string> names) {
  names.resize(kModelColumns);
  for (std::string& name : names) name += "_prior";
  return names;
}

Block Accuracy(Reader& read) {
  Block block("ACCURACY", {"k = 1", "k = 5", "k = 6", "k = 10", "CV", "CTRA", "FADED"});
  read.Row(block, "minADE, m", Hundredths, Best("ade"));
  read.Row(block, "minFDE, m", Hundredths, Best("fde"));
  read.Row(block, "brier-minFDE, Argoverse 2", Hundredths, Each("brier_fde"));
  read.Row(block, "missed, Argoverse 2", Share, Each("miss_rate"));
  read.Row(block, "missed, nuScenes", Share, Each("miss_rate_nuscenes"));
  read.Row(block, "missed, Waymo", Share, Each("miss_rate_waymo"));
  read.Row(block, "minADE, Waymo, m", Hundredths, Best("ade_waymo"));
  read.Row(block, "minFDE, Waymo, m", Hundredths, Best("fde_waymo"));
  // With k representatives instead of the k most probable actions.
  read.Row(block, "medoid, covering minADE, m", Hundredths, Cover("ade", "min_"));
  read.Row(block, "medoid, covering minFDE, m", Hundredths, Cover("fde", "min_"));
  read.Row(block, "medoid, covering missed, Argoverse 2", Share, Cover("miss_rate", ""));
  read.Row(block, "generic minADE, m", Hundredths, Prior(Best("ade")));
  read.Row(block, "generic minFDE, m", Hundredths, Prior(Best("fde")));
  read.Row(block, "generic missed, Argoverse 2", Share, Prior(Each("miss_rate")));
  read.Row(block, "minADE by ADE of CV", Thousandths, {"ade_ratio", "", "min_ade_6_ratio"});
  read.Row(block, "minFDE by FDE of CV", Thousandths, {"fde_ratio", "", "min_fde_6_ratio"});
  read.Row(block, "medoid's ADE by ADE of CV", Thousandths, {"ade_medoid_ratio"});
  read.Row(block, "medoid's FDE by FDE of CV", Thousandths, {"fde_medoid_ratio"});
  return block;
}

// Returns the model beside the trained baselines and beside those that learn nothing. Empty unless
// the model's folder has baselines.
Block Baselines(Reader& read, const Metrics& metrics) {
  Block block("BASELINES", {"MODEL", "COVERNET-LIKE", "MULTIPATH-LIKE", "CV", "CTRA", "FADED"});
  if (!metrics.contains("covernet_nll")) return block;
  const auto row = [&](std::string label, Format format, const std::string& name,
                       const std::string& simple = "") {
    std::vector<std::string> names = {name, "covernet_" + name, "multipath_" + name};
    if (!simple.empty()) {
      names.insert(names.end(), {simple + "_cv", simple + "_ctra", simple + "_faded"});
    }
    read.Row(block, std::move(label), format, names);
  };
  row("ADE, m", Hundredths, "ade_1", "ade");
  row("FDE, m", Hundredths, "fde_1", "fde");
  for (const char* k : {"5", "6", "10"}) {
    row(absl::StrCat("minADE, k = ", k, ", m"), Hundredths, absl::StrCat("min_ade_", k));
    row(absl::StrCat("minFDE, k = ", k, ", m"), Hundredths, absl::StrCat("min_fde_", k));
  }
  for (const char* k : {"1", "5", "6", "10"}) {
    const std::string simple = k == std::string("1") ? "miss_rate" : "";
    row(absl::StrCat("missed, k = ", k, ", Argoverse 2"), Share, absl::StrCat("miss_rate_", k),
        simple);
    row(absl::StrCat("missed, k = ", k, ", nuScenes"), Share,
        absl::StrCat("miss_rate_nuscenes_", k), simple.empty() ? "" : "miss_rate_nuscenes");
    row(absl::StrCat("missed, k = ", k, ", Waymo"), Share, absl::StrCat("miss_rate_waymo_", k),
        simple.empty() ? "" : "miss_rate_waymo");
    row(absl::StrCat("brier-minFDE, k = ", k), Hundredths, absl::StrCat("brier_fde_", k));
  }
  row("NLL a waypoint, nats", Thousandths, "nll");
  row("NLL a trajectory, nats", Thousandths, "nll_joint");
  row("calibration error", Thousandths, "calibration_error");
  row("effective actions or anchors", Count, "effective_actions");
  row("perplexity of the mean", Hundredths, "action_perplexity");
  row("largest mean probability", Share, "largest_share");
  row("mutual information, nats", Thousandths, "mutual_information");
  return block;
}

Block Likelihood(Reader& read) {
  Block block("LIKELIHOOD (-ln p, nats)", {"MODEL", "GENERIC"});
  read.Row(block, "mixture, a waypoint", Thousandths, {"nll", "nll_prior"});
  read.Row(block, "mixture, a trajectory", Thousandths, {"nll_joint", "nll_joint_prior"});
  read.Row(block, "likeliest q(y|x,s), a waypoint", Thousandths,
           {"nll_action", "nll_action_prior"});
  return block;
}

Block Envelope(Reader& read) {
  Block block("ENVELOPE", {"MODEL", "GENERIC", "GAUSSIAN"});
  const auto coverage = [&](const std::string& label, const std::string& name, double gaussian) {
    const std::string model = read.Read(name, Share);
    if (!model.empty()) {
      block.Add(label, {model, read.Read(name + "_prior", Share), Share(gaussian)});
    }
  };
  coverage("holds the truth, 1 sigma", "coverage_1sigma", kGaussianOneSigma);
  coverage("holds the truth, 2 sigma", "coverage_2sigma", kGaussianTwoSigma);
  coverage("latent alone, 1 sigma", "coverage_1sigma_latent", kGaussianOneSigma);
  coverage("latent alone, 2 sigma", "coverage_2sigma_latent", kGaussianTwoSigma);
  read.Row(block, "mean sigma of the latent, m", Hundredths,
           {"mean_sigma_posterior", "mean_sigma_prior"});
  read.Row(block, "  by the generic one", Thousandths, {"mean_sigma_ratio"});
  return block;
}

Block Actions(Reader& read) {
  Block block("ACTIONS", {"VALUE"});
  read.Row(block, "effective", Count, {"effective_actions"});
  read.Row(block, "largest mean p(y|s)", Share, {"largest_share"});
  read.Row(block, "perplexity of the mean p(y|s)", Hundredths, {"action_perplexity"});
  read.Row(block, "mean entropy of p(y|s), nats", Thousandths, {"action_entropy"});
  read.Row(block, "I(y;s), nats", Thousandths, {"mutual_information"});
  read.Row(block, "calibration error", Thousandths, {"calibration_error"});
  return block;
}

// Returns how well the actions agree with classes of trajectories.
Block Meaning(Reader& read) {
  Block block("MEANING", {"KINEMATIC", "RELATIVE", "RECORDED"});
  read.Row(block, "NMI of action and class", Thousandths, {"nmi_kinematic", "nmi_relative", "nmi"});
  read.Row(block, "purity of the actions", Thousandths,
           {"purity_kinematic", "purity_relative", "purity"});
  read.Row(block, "class information, given the speed", Share,
           {"class_information_kinematic", "class_information_relative"});
  read.Row(block, "examples in actions of purity 0.7", Share, {"", "named_share_relative"});
  read.Row(block, "the same, standing as keeping", Share, {"", "named_share_motion"});
  read.Row(block, "examples with a manoeuvre", Count, {"", "", "labelled_examples"});
  return block;
}

Block Reliability(const v1::EvaluationReport& report) {
  Block block("p(y|s) OF THE LIKELIEST", {"EXAMPLES", "MEAN p(y|s)", "MEAN q(y|x,s)"});
  for (const v1::ReliabilityBin& bin : report.reliability()) {
    if (bin.examples() == 0) continue;
    block.Add(absl::StrFormat("%.1f to %.1f", bin.lower(), bin.upper()),
              {absl::StrCat(bin.examples()), Thousandths(bin.mean_confidence()),
               Thousandths(bin.mean_responsibility())});
  }
  return block;
}

Block ActionUses(const v1::EvaluationReport& report, std::span<const std::string> names) {
  Block block("WHAT EACH ACTION DOES",
              {"MEAN p(y|s)", "EXAMPLES", "RELATIVE", "PURITY", "KINEMATIC", "PURITY"});
  std::vector<int> order;
  for (int i = 0; i < report.action_uses_size(); ++i) order.push_back(i);
  std::stable_sort(order.begin(), order.end(), [&](int a, int b) {
    return report.action_uses(a).probability() > report.action_uses(b).probability();
  });
  for (const int action : order) {
    const v1::ActionUse& use = report.action_uses(action);
    const bool used = use.examples() > 0;
    // Reports of older releases have no relative classes.
    const bool has_relative = !use.relative_class().empty();
    const auto id = static_cast<size_t>(action);
    block.Add(absl::StrCat(action, id < names.size() ? absl::StrCat("  ", names[id]) : ""),
              {Share(use.probability()), absl::StrCat(use.examples()), use.relative_class(),
               has_relative ? Share(use.relative_class_share()) : "", use.kinematic_class(),
               used ? Share(use.class_share()) : ""});
  }
  return block;
}

Block Strata(const v1::EvaluationReport& report) {
  Block block("EXAMPLES BY",
              {"EXAMPLES", "ADE", "medoid", "CV", "CTRA", "faded", "minADE6", "FDE", "CV", "CTRA",
               "faded", "minFDE6", "missed6", "NLL", "2 sigma", "ECE"});
  for (const v1::EvaluationStratum& stratum : report.strata()) {
    // Most models predict only one type.
    if (stratum.dimension() == "type" && stratum.examples() == 0) continue;
    Reader read(stratum.metrics());
    std::vector<std::string> values = {absl::StrCat(stratum.examples())};
    for (const auto& [name, format] :
         std::vector<std::pair<const char*, Format>>{{"ade_1", Hundredths},
                                                     {"ade_medoid", Hundredths},
                                                     {"ade_cv", Hundredths},
                                                     {"ade_ctra", Hundredths},
                                                     {"ade_faded", Hundredths},
                                                     {"min_ade_6", Hundredths},
                                                     {"fde_1", Hundredths},
                                                     {"fde_cv", Hundredths},
                                                     {"fde_ctra", Hundredths},
                                                     {"fde_faded", Hundredths},
                                                     {"min_fde_6", Hundredths},
                                                     {"miss_rate_6", Share},
                                                     {"nll", Thousandths},
                                                     {"coverage_2sigma", Share},
                                                     {"calibration_error", Thousandths}}) {
      values.push_back(read.Read(name, format));
    }
    block.Add(absl::StrCat(stratum.dimension(), ": ", stratum.name()), std::move(values));
  }
  return block;
}

}  // namespace

std::string ReportText(const v1::EvaluationReport& report, bool color,
                       std::span<const std::string> action_names) {
  Reader read(report.metrics());
  std::vector<Block> blocks = {Accuracy(read),      Baselines(read, report.metrics()),
                               Likelihood(read),    Envelope(read),
                               Reliability(report), Actions(read),
                               Meaning(read),       ActionUses(report, action_names),
                               Strata(report)};
  Block other("OTHER", {"VALUE"});
  for (const auto& [name, value] : read.Left()) other.Add(name, {Thousandths(value)});
  blocks.push_back(std::move(other));
  std::string text;
  for (const Block& block : blocks) {
    if (!block.empty()) absl::StrAppend(&text, text.empty() ? "" : "\n", block.Text(color));
  }
  const std::string rivals = RivalText(report.rivals(), color);
  if (!rivals.empty()) absl::StrAppend(&text, text.empty() ? "" : "\n", rivals);
  // A manifest's metrics have no count of examples; an evaluation's do.
  if (report.examples() > 0 && report.metrics().contains("ade_cv") &&
      !report.metrics().contains("covernet_nll")) {
    absl::StrAppend(
        &text,
        "\nThis model carries no trained baselines. maneuver train --set baselines=true "
        "adds a CoverNet-like\nand a MultiPath-like one, and every evaluation then has "
        "their rows.\n");
  }
  return text;
}

}  // namespace maneuver::evaluation
