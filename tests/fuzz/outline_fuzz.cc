// What the server reads of a message before it parses it, against the parser; and what a message of
// a stream asks.

#include <grpcpp/support/byte_buffer.h>

#include <algorithm>
#include <set>
#include <variant>
#include <vector>

#include "maneuver/v1/prediction_service.pb.h"
#include "server/rpc/prediction_query.h"
#include "server/rpc/request_outline.h"
#include "tests/fuzz/harness.h"

namespace maneuver::fuzz {
namespace {

// In pieces, as they arrive from the network.
grpc::ByteBuffer BufferOf(std::string_view bytes, size_t piece) {
  std::vector<grpc::Slice> slices;
  for (size_t at = 0; at < bytes.size(); at += piece) {
    const std::string_view part = bytes.substr(at, piece);
    slices.emplace_back(part.data(), part.size());
  }
  return {slices.data(), slices.size()};
}

size_t TargetsOf(const v1::PredictRequest& request) {
  size_t targets = 0;
  for (const v1::Scenario& scenario : request.scenarios()) {
    targets += static_cast<size_t>(scenario.target_ids_size());
  }
  return targets;
}

void ExpectOutline(std::string_view bytes, size_t piece) {
  const auto outline = rpc::ReadStreamOutline(BufferOf(bytes, piece));
  v1::StreamPredictRequest message;
  const bool parses = message.ParseFromArray(bytes.data(), static_cast<int>(bytes.size()));
  if (!parses) return;
  Expect(outline.has_value(), "what parses has an outline");
  Expect(outline->request_id == message.request_id(), "the outline has the request's id");
  Expect(outline->timeout.has_value() == message.has_timeout(), "the outline has the timeout");
  if (outline->timeout) {
    Expect(outline->timeout->seconds() == message.timeout().seconds() &&
               outline->timeout->nanos() == message.timeout().nanos(),
           "the outline has the timeout's value");
  }
  Expect(outline->targets == TargetsOf(message.request()), "the outline counts the targets");

  const std::string request = message.request().SerializeAsString();
  Expect(rpc::CountTargets(BufferOf(request, piece)) == TargetsOf(message.request()),
         "targets are counted before parsing");
}

void ExpectQuery(const v1::DistributionQuery& query) {
  constexpr int kActions = 7;
  const auto question = rpc::ParseQuery(query, kActions);
  if (!question.ok()) {
    Expect(question.status().code() == absl::StatusCode::kInvalidArgument,
           "a query is refused by its field");
    return;
  }
  Expect(question->representatives >= 0 && question->representatives <= kActions,
         "as many representatives as actions, at most");
  Expect(question->combinations >= 0 && question->combinations <= 64, "64 combinations, at most");
  if (const auto* ids = std::get_if<serving::ActionIds>(&question->selection)) {
    std::set<int> once(ids->ids.begin(), ids->ids.end());
    Expect(once.size() == ids->ids.size(), "each action once");
    Expect(once.empty() || (*once.begin() >= 0 && *once.rbegin() < kActions), "actions exist");
  } else if (const auto* top = std::get_if<serving::TopK>(&question->selection)) {
    Expect(top->k >= 1, "more than K are all");
  } else {
    const double least = std::get<serving::AtLeast>(question->selection).probability;
    Expect(least >= 0.0 && least <= 1.0, "a probability is one");
  }
}

}  // namespace

void Outline(std::string_view bytes) {
  ExpectOutline(bytes, std::max<size_t>(bytes.size(), 1));
  ExpectOutline(bytes, 7);
  // Any bytes will do for a count.
  rpc::CountTargets(BufferOf(bytes, 5));
  v1::StreamPredictRequest message;
  ParseMessage(bytes, &message);
  ExpectQuery(message.request().query());
  const auto priority = rpc::ParsePriority(message.request().priority());
  Expect(priority.ok() || priority.status().code() == absl::StatusCode::kInvalidArgument,
         "a priority is known or refused");
}

}  // namespace maneuver::fuzz
