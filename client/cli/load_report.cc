#include "client/cli/load_report.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <utility>

#include "absl/strings/str_cat.h"
#include "client/cli/table.h"
#include "client/cli/text_format.h"

namespace maneuver::cli {
namespace {

using load::HistogramChange;
using load::LatencyHistogram;
using load::ServerChange;
using load::Tally;
using Json = nlohmann::ordered_json;

constexpr double kQuantiles[] = {0.5, 0.9, 0.99, 0.999};

double Milliseconds(std::chrono::nanoseconds time) {
  return std::chrono::duration<double, std::milli>(time).count();
}

// Three digits or so, whatever the size.
std::string Short(double value) {
  const double size = std::abs(value);
  return Fixed(value, size < 9.995 ? 2 : size < 99.95 ? 1 : 0);
}

std::string Count(const std::optional<double>& value) { return value ? Fixed(*value, 0) : "-"; }

HistogramChange Stage(const ServerChange& server, const char* stage) {
  return load::Change(server.before, server.after, "maneuver_stage_duration_seconds",
                      {{"stage", stage}});
}

HistogramChange BatchSize(const ServerChange& server) {
  return load::Change(server.before, server.after, "maneuver_batch_size");
}

// Nothing if the server does not count that.
std::optional<double> Growth(const ServerChange& server, const char* counter,
                             const load::MetricLabels& labels) {
  const auto after = server.after.Sum(counter, labels);
  if (!after) return std::nullopt;
  return *after - server.before.Sum(counter, labels).value_or(0.0);
}

std::optional<double> Targets(const ServerChange& server, const char* outcome) {
  return Growth(server, "maneuver_targets_total", {{"outcome", outcome}});
}

Table CallersTable(const LoadReport& report) {
  Table table({{"LOAD"},
               {"OFFERED/s", Align::kRight},
               {"ANSWERED/s", Align::kRight},
               {"TARGETS/s", Align::kRight},
               {"REFUSED", Align::kRight},
               {"EXPIRED", Align::kRight},
               {"FAILED", Align::kRight},
               {"p50 ms", Align::kRight},
               {"p90 ms", Align::kRight},
               {"p99 ms", Align::kRight},
               {"p99.9 ms", Align::kRight},
               {"max ms", Align::kRight}});
  for (const LoadStep& step : report.steps) {
    const Tally& tally = step.tally;
    std::vector<std::string> cells = {
        step.name,
        Short(tally.OfferedRate()),
        Short(tally.AnsweredRate()),
        Short(tally.AnsweredTargetRate()),
        absl::StrCat(tally.Ended(absl::StatusCode::kResourceExhausted)),
        absl::StrCat(tally.Ended(absl::StatusCode::kDeadlineExceeded)),
        absl::StrCat(tally.Failed())};
    const LatencyHistogram& latency = tally.answer_latency;
    for (const double quantile : kQuantiles) {
      cells.push_back(latency.count() > 0 ? Short(Milliseconds(latency.Quantile(quantile))) : "-");
    }
    cells.push_back(latency.count() > 0 ? Short(Milliseconds(latency.max())) : "-");
    table.Add(std::move(cells));
  }
  return table;
}

// Empty if no metrics were read.
Table ServerTable(const LoadReport& report) {
  Table table({{"SERVER UNDER"},
               {"QUEUE ms", Align::kRight},
               {"p99 ms", Align::kRight},
               {"BATCH", Align::kRight},
               {"RASTER ms", Align::kRight},
               {"VECTORS ms", Align::kRight},
               {"ENCODE ms", Align::kRight},
               {"DESCRIBE ms", Align::kRight},
               {"ANSWERED", Align::kRight},
               {"EXPIRED", Align::kRight},
               {"CANCELLED", Align::kRight},
               {"REFUSED", Align::kRight},
               {"MOST QUEUED", Align::kRight},
               {"MEMORY", Align::kRight}});
  for (const LoadStep& step : report.steps) {
    if (!step.server) continue;
    const ServerChange& server = *step.server;
    const auto memory = server.peaks.memory_bytes;
    table.Add(
        {step.name, Short(1e3 * Stage(server, "queue").Mean()),
         Short(1e3 * Stage(server, "queue").Quantile(0.99)), Short(BatchSize(server).Mean()),
         Short(1e3 * Stage(server, "raster").Mean()), Short(1e3 * Stage(server, "vectors").Mean()),
         Short(1e3 * Stage(server, "encode").Mean()), Short(1e3 * Stage(server, "describe").Mean()),
         Count(Targets(server, "answered")), Count(Targets(server, "expired")),
         Count(Targets(server, "cancelled")), Count(Targets(server, "refused")),
         Count(server.peaks.queued_targets), memory ? Bytes(static_cast<int64_t>(*memory)) : "-"});
  }
  return table;
}

std::string Remarks(const LoadStep& step) {
  const Tally& tally = step.tally;
  std::string text;
  const auto remark = [&](const auto&... parts) {
    absl::StrAppend(&text, step.name, ": ", parts..., "\n");
  };
  if (tally.only_warm_up) {
    remark("every call fell into the warm-up; set --warm-up 0 or more --calls");
  }
  if (const int64_t refused = tally.Ended(absl::StatusCode::kResourceExhausted); refused > 0) {
    const std::string delay =
        tally.refused_with_delay == 0
            ? ""
            : absl::StrCat(", ", Short(Milliseconds(tally.least_delay)), " to ",
                           Short(Milliseconds(tally.most_delay)), " ms");
    remark(tally.refused_with_delay, " of ", refused, " refused calls were told to wait", delay,
           "; they were refused after ", Short(Milliseconds(tally.refusal_latency.Quantile(0.5))),
           " ms (p50), ", Short(Milliseconds(tally.refusal_latency.Quantile(0.99))), " ms (p99)");
  }
  if (tally.held_back > 0) {
    remark(tally.held_back,
           " of them were held back by the client library, because the server refused too many "
           "calls; --send-all sends them too");
  }
  if (tally.refused_targets > 0) {
    remark(tally.refused_targets,
           " targets were refused in answers: ", Printable(std::string(tally.failure.message())));
  }
  if (tally.unsent > 0) {
    remark(tally.unsent, " calls were never sent: more than ", step.plan.max_in_flight,
           " were in flight (--max-in-flight)");
  }
  if (tally.unfinished > 0) remark(tally.unfinished, " calls had not ended when the run did");
  const double lateness = Milliseconds(tally.lateness.Quantile(0.99));
  if (lateness > 2.0) {
    const bool is_full = 100 * tally.waited >= tally.lateness.count();
    const std::string cause =
        is_full ? absl::StrCat(tally.waited, " waited because ", step.plan.max_in_flight,
                               " were in flight (--max-in-flight)")
                : "the load generator lacks processor time";
    remark("calls were sent up to ", Short(lateness),
           " ms late (p99), which counts as latency: ", cause);
  }
  return text;
}

Json ToJson(const LatencyHistogram& latency) {
  Json json = {{"count", latency.count()}};
  if (latency.count() == 0) return json;
  json["mean"] = Milliseconds(latency.mean());
  json["p50"] = Milliseconds(latency.Quantile(0.5));
  json["p90"] = Milliseconds(latency.Quantile(0.9));
  json["p99"] = Milliseconds(latency.Quantile(0.99));
  json["p99_9"] = Milliseconds(latency.Quantile(0.999));
  json["max"] = Milliseconds(latency.max());
  return json;
}

// null for what the server does not say; JSON knows no NaN.
Json Number(const std::optional<double>& value) {
  return value && std::isfinite(*value) ? Json(*value) : Json();
}

Json ToJson(const ServerChange& server) {
  Json json;
  for (const char* outcome : {"answered", "expired", "cancelled", "refused"}) {
    json["targets"][outcome] = Number(Targets(server, outcome));
  }
  for (const char* after : {"nothing", "queue", "raster", "encode"}) {
    json["dropped_after"][after] =
        Number(Growth(server, "maneuver_dropped_targets_total", {{"after", after}}));
  }
  json["batch_size_mean"] = Number(BatchSize(server).Mean());
  json["batched_targets"] = Number(BatchSize(server).sum);
  for (const char* stage : {"queue", "raster", "vectors", "encode", "describe"}) {
    const HistogramChange change = Stage(server, stage);
    json["stages_ms"][stage] = {{"count", change.count},
                                {"mean", Number(1e3 * change.Mean())},
                                {"p50", Number(1e3 * change.Quantile(0.5))},
                                {"p99", Number(1e3 * change.Quantile(0.99))}};
  }
  json["most_queued_targets"] = Number(server.peaks.queued_targets);
  json["most_memory_bytes"] = Number(server.peaks.memory_bytes);
  return json;
}

Json ToJson(const LoadStep& step) {
  const Tally& tally = step.tally;
  Json json = {{"name", step.name}};
  if (const auto* open = std::get_if<load::OpenLoop>(&step.plan.loop)) {
    json["rate"] = open->rate;
  } else {
    json["callers"] = std::get<load::ClosedLoop>(step.plan.loop).callers;
  }
  json["seconds"] = std::chrono::duration<double>(tally.length).count();
  json["calls_due"] = tally.due;
  json["calls_answered"] = tally.answered_calls;
  json["targets_answered"] = tally.answered_targets;
  json["offered_per_second"] = tally.OfferedRate();
  json["answered_per_second"] = tally.AnsweredRate();
  json["answered_targets_per_second"] = tally.AnsweredTargetRate();
  json["ended"] = Json::object();
  for (const auto& [code, count] : tally.ended)
    json["ended"][absl::StatusCodeToString(code)] = count;
  json["unsent"] = tally.unsent;
  json["unfinished"] = tally.unfinished;
  json["refused_with_delay"] = tally.refused_with_delay;
  json["held_back"] = tally.held_back;
  json["retry_delay_ms"] = {{"least", Milliseconds(tally.least_delay)},
                            {"most", Milliseconds(tally.most_delay)}};
  json["refused_targets"] = tally.refused_targets;
  json["latency_ms"] = ToJson(tally.answer_latency);
  json["refusal_latency_ms"] = ToJson(tally.refusal_latency);
  json["lateness_ms"] = ToJson(tally.lateness);
  if (!tally.failure.ok())
    json["failure"] = tally.failure.ToString(absl::StatusToStringMode::kDefault);
  if (step.server) json["server"] = ToJson(*step.server);
  return json;
}

}  // namespace

std::string LoadReportText(const LoadReport& report, TableStyle style) {
  const auto print = [style](const Table& table) {
    return style == TableStyle::kMarkdown ? table.Markdown()
                                          : table.Text(style == TableStyle::kColorText);
  };
  std::string text = print(CallersTable(report));
  const Table server = ServerTable(report);
  if (!server.empty()) absl::StrAppend(&text, "\n", print(server));
  std::string remarks;
  for (const LoadStep& step : report.steps) remarks += Remarks(step);
  if (!remarks.empty()) absl::StrAppend(&text, "\n", remarks);
  return text;
}

std::string LoadReportJson(const LoadReport& report) {
  Json json = {{"server", report.server},
               {"requests", report.requests},
               {"targets_per_request", report.mean_targets},
               {"bytes_per_request", report.mean_bytes},
               {"connections", report.connections},
               {"capacity", Number(report.capacity)},
               {"interrupted", report.interrupted},
               {"steps", Json::array()}};
  for (const LoadStep& step : report.steps) json["steps"].push_back(ToJson(step));
  // A server's message may be no UTF-8.
  return json.dump(2, ' ', false, Json::error_handler_t::replace) + "\n";
}

}  // namespace maneuver::cli
