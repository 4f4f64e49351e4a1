// What tests of the client begin with: a client that retries fast, and reports of outcomes.

#ifndef MANEUVER_TESTS_UNIT_CLIENT_TEST_CALLS_H_
#define MANEUVER_TESTS_UNIT_CLIENT_TEST_CALLS_H_

#include <grpcpp/support/status.h>
#include <grpcpp/support/sync_stream.h>

#include <memory>
#include <string>

#include "client/client.h"
#include "maneuver/v1/outcome_service.pb.h"

namespace maneuver::client {

inline ClientOptions OptionsFor(const std::string& address, int max_attempts = 4) {
  ClientOptions options;
  options.address = address;
  options.retry.max_attempts = max_attempts;
  options.retry.initial_backoff = absl::Milliseconds(1);
  options.retry.max_backoff = absl::Milliseconds(2);
  options.watch_patience = absl::Seconds(20);
  return options;
}

inline std::unique_ptr<Client> ConnectTo(const std::string& address, int max_attempts = 4) {
  return *Client::Connect(OptionsFor(address, max_attempts));
}

inline grpc::Status Unavailable() { return {grpc::StatusCode::UNAVAILABLE, "busy"}; }

using OutcomeServerStream =
    grpc::ServerReaderWriter<v1::StreamOutcomesResponse, v1::StreamOutcomesRequest>;

// Answers a report with its id and, as index of a score, its number of outcomes.
inline void AnswerReport(const v1::ReportOutcomesRequest& report, OutcomeServerStream* stream) {
  v1::StreamOutcomesResponse response;
  response.set_request_id(report.request_id());
  if (report.outcomes().empty()) {
    response.mutable_error()->set_code(static_cast<int>(grpc::StatusCode::INVALID_ARGUMENT));
    response.mutable_error()->set_message("outcomes: name at least one");
  } else {
    response.mutable_response()->add_scores()->set_outcome_index(report.outcomes_size());
  }
  stream->Write(response);
}

inline v1::ReportOutcomesRequest ReportOf(int outcomes) {
  v1::ReportOutcomesRequest report;
  for (int i = 0; i < outcomes; ++i) report.add_outcomes();
  return report;
}

}  // namespace maneuver::client

#endif  // MANEUVER_TESTS_UNIT_CLIENT_TEST_CALLS_H_
