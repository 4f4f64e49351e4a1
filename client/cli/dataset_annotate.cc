#include "client/cli/dataset_annotate.h"

#include <map>
#include <ostream>
#include <set>

#include "absl/strings/str_cat.h"
#include "client/cli/command.h"
#include "client/cli/interrupt.h"
#include "client/cli/table.h"
#include "client/cli/text_format.h"
#include "model/data/label_file.h"
#include "model/files/durable_file.h"

namespace maneuver::cli {
namespace {

int RefuseLabels(const std::string& file, const data::CheckedLabels& labels,
                 Environment& environment) {
  for (const data::LabelProblem& problem : labels.problems) {
    environment.err << file << ":" << problem.line << ": " << problem.what << "\n";
  }
  const auto shown = static_cast<int64_t>(labels.problems.size());
  if (labels.problem_count > shown) {
    environment.err << "... and " << labels.problem_count - shown << " more\n";
  }
  return environment.Refuse(absl::StrCat(labels.problem_count, " of the lines of ", file,
                                         " cannot be used; nothing was written"));
}

}  // namespace

int AnnotateDataset(const AnnotateArguments& arguments, Environment& environment) {
  const auto text = files::ReadInput(arguments.labels);
  if (!text.ok()) return environment.FailAt(arguments.labels, text.status());
  const std::set<std::string> actions(arguments.actions.begin(), arguments.actions.end());
  const auto labels = data::CheckLabels(*text, arguments.folder, actions);
  if (!labels.ok()) return environment.Fail(labels.status());
  if (labels->problem_count > 0) return RefuseLabels(arguments.labels, *labels, environment);
  const Interrupt interrupt([] {});
  const auto dataset =
      data::AnnotateDataset(arguments.folder, labels->annotations, arguments.output,
                            [&interrupt] { return interrupt.happened(); });
  if (!dataset.ok()) return environment.Fail(dataset.status());
  if (environment.json()) {
    environment.PrintJson(*dataset);
    return kOk;
  }
  std::map<std::string, int64_t> counts;
  for (const auto& annotation : labels->annotations) ++counts[annotation.maneuver()];
  Table table({{"ACTION"}, {"LABELS", Align::kRight}});
  for (const auto& [action, count] : counts) table.Add({action, absl::StrCat(count)});
  environment.out << table.Text(environment.color);
  environment.err << arguments.output << ": " << HowMany(dataset->recordings(), "recording") << ", "
                  << HowMany(static_cast<int64_t>(labels->annotations.size()), "label")
                  << "; train with examples.label_share=1\n";
  return kOk;
}

}  // namespace maneuver::cli
