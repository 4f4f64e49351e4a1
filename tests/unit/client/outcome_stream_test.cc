#include "client/outcome_stream.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <future>
#include <map>
#include <mutex>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "client/client.h"
#include "client/error_details.h"
#include "tests/unit/client/test_calls.h"
#include "tests/unit/client/test_server.h"

namespace maneuver::client::outcome_stream_test {
namespace {

TEST(OutcomeStreamTest, AStreamOfOutcomesGetsAnAnswerForEachReportInOrder) {
  TestServer server;
  server.on_stream_outcomes = [](OutcomeServerStream* stream) {
    v1::StreamOutcomesRequest request;
    while (stream->Read(&request)) AnswerReport(request.report(), stream);
    return grpc::Status::OK;
  };
  const auto client = ConnectTo(server.address());
  std::vector<int> answers;
  const std::thread::id mine = std::this_thread::get_id();
  const auto stream = client->StreamOutcomes([&](const auto& report, const auto& answer) {
    EXPECT_EQ(std::this_thread::get_id(), mine);
    if (report.outcomes().empty()) {
      EXPECT_TRUE(absl::IsInvalidArgument(answer.status())) << answer.status();
      answers.push_back(0);
    } else {
      EXPECT_EQ(answer->scores(0).outcome_index(), report.outcomes_size());
      answers.push_back(report.outcomes_size());
    }
  });
  std::vector<int> sent;
  for (int i = 0; i < 20; ++i) {
    sent.push_back(i % 7);
    ASSERT_TRUE(stream->Send(ReportOf(i % 7)).ok());
    EXPECT_LT(sent.size() - answers.size(), 4U);
  }
  EXPECT_TRUE(stream->Finish().ok());
  EXPECT_EQ(answers, sent);
  EXPECT_TRUE(absl::IsFailedPrecondition(stream->Send(ReportOf(1))));
}

TEST(OutcomeStreamTest, ABrokenStreamOfOutcomesIsResumedWithWhatHasNoAnswer) {
  TestServer server;
  std::mutex mutex;
  std::map<std::string, int> arrived;  // by request_id
  int streams = 0;
  server.on_stream_outcomes = [&](OutcomeServerStream* stream) {
    {
      const std::lock_guard lock(mutex);
      ++streams;
    }
    v1::StreamOutcomesRequest request;
    for (int i = 0; stream->Read(&request); ++i) {
      const std::lock_guard lock(mutex);
      ++arrived[request.report().request_id()];
      // The third report of each stream arrives, and its answer is lost.
      if (i == 2) return Unavailable();
      AnswerReport(request.report(), stream);
    }
    return grpc::Status::OK;
  };
  const auto client = ConnectTo(server.address());
  std::vector<int> answers;
  const auto stream = client->StreamOutcomes([&](const auto&, const auto& answer) {
    ASSERT_TRUE(answer.ok()) << answer.status();
    answers.push_back(answer->scores(0).outcome_index());
  });
  for (int i = 1; i <= 9; ++i) ASSERT_TRUE(stream->Send(ReportOf(i)).ok());
  const absl::Status end = stream->Finish();
  EXPECT_TRUE(end.ok()) << end;
  EXPECT_EQ(answers, (std::vector<int>{1, 2, 3, 4, 5, 6, 7, 8, 9}));
  EXPECT_EQ(arrived.size(), 9U);  // a report that is sent again keeps its id
  EXPECT_GE(streams, 4);
}

// Returns the answer of a server that wants to have a report again later.
v1::StreamOutcomesResponse Postponed(absl::Duration delay = absl::Milliseconds(20)) {
  const absl::Status busy = WithDetails(absl::ResourceExhaustedError("too many outcomes wait"),
                                        {.reason = "TOO_MANY_REQUESTS", .retry_delay = delay});
  v1::StreamOutcomesResponse response;
  v1::Status& error = *response.mutable_error();
  error.set_code(static_cast<int>(busy.code()));
  error.set_message(std::string(busy.message()));
  busy.ForEachPayload([&error](absl::string_view type, const absl::Cord& value) {
    google::protobuf::Any& detail = *error.add_details();
    detail.set_type_url(std::string(type));
    detail.set_value(std::string(value));
  });
  return response;
}

TEST(OutcomeStreamTest, AReportOfOutcomesThatIsPostponedIsSentAgainAndTheAnswersKeepTheirOrder) {
  TestServer server;
  std::mutex mutex;
  std::map<std::string, int> arrived;  // by request_id
  std::vector<absl::Time> postponed;
  int streams = 0;
  server.on_stream_outcomes = [&](OutcomeServerStream* stream) {
    {
      const std::lock_guard lock(mutex);
      ++streams;
    }
    v1::StreamOutcomesRequest request;
    while (stream->Read(&request)) {
      const v1::ReportOutcomesRequest& report = request.report();
      const std::lock_guard lock(mutex);
      // The first report and the fifth are postponed twice each, those after them answered.
      const int times = ++arrived[report.request_id()];
      const bool is_busy = report.outcomes_size() % 4 == 1 && times <= 2;
      if (is_busy) postponed.push_back(absl::Now());
      if (is_busy) {
        stream->Write(Postponed());
      } else {
        AnswerReport(report, stream);
      }
    }
    return grpc::Status::OK;
  };
  const auto client = ConnectTo(server.address());
  std::vector<int> answers;
  const auto stream = client->StreamOutcomes([&](const auto&, const auto& answer) {
    ASSERT_TRUE(answer.ok()) << answer.status();
    answers.push_back(answer->scores(0).outcome_index());
  });
  for (int i = 1; i <= 8; ++i) ASSERT_TRUE(stream->Send(ReportOf(i)).ok());
  const absl::Status end = stream->Finish();
  EXPECT_TRUE(end.ok()) << end;
  EXPECT_EQ(answers, (std::vector<int>{1, 2, 3, 4, 5, 6, 7, 8}));
  EXPECT_EQ(streams, 1);
  ASSERT_EQ(arrived.size(), 8U);
  int sent = 0;
  for (const auto& [id, times] : arrived) sent += times;
  EXPECT_EQ(sent, 6 + 2 * 3);  // an answered report is not sent again
  ASSERT_EQ(postponed.size(), 4U);
  EXPECT_GE(postponed[1] - postponed[0], absl::Milliseconds(20));
}

TEST(OutcomeStreamTest, AStreamOfOutcomesThatBrokeIsPatientWithAPostponedReport) {
  TestServer server;
  std::atomic<int> streams = 0;
  server.on_stream_outcomes = [&](OutcomeServerStream* stream) {
    if (++streams == 1) return Unavailable();
    v1::StreamOutcomesRequest request;
    for (int times = 1; stream->Read(&request); ++times) {
      if (times <= 10) {  // more than a server that was never reached would be asked
        stream->Write(Postponed());
      } else {
        AnswerReport(request.report(), stream);
      }
    }
    return grpc::Status::OK;
  };
  const auto client = ConnectTo(server.address());
  int answers = 0;
  const auto stream = client->StreamOutcomes([&](const auto&, const auto& answer) {
    EXPECT_TRUE(answer.ok()) << answer.status();
    ++answers;
  });
  stream->Send(ReportOf(1)).IgnoreError();
  const absl::Status end = stream->Finish();
  EXPECT_TRUE(end.ok()) << end;
  EXPECT_EQ(answers, 1);
  EXPECT_EQ(streams, 2);
}

TEST(OutcomeStreamTest, AReportOfOutcomesThatIsRefusedWithoutADelayIsNotSentAgain) {
  TestServer server;
  std::atomic<int> reports = 0;
  server.on_stream_outcomes = [&](OutcomeServerStream* stream) {
    v1::StreamOutcomesRequest request;
    while (stream->Read(&request)) {
      ++reports;
      v1::StreamOutcomesResponse refusal;
      refusal.mutable_error()->set_code(static_cast<int>(grpc::StatusCode::RESOURCE_EXHAUSTED));
      stream->Write(refusal);
    }
    return grpc::Status::OK;
  };
  const auto client = ConnectTo(server.address());
  int refused = 0;
  const auto stream = client->StreamOutcomes([&](const auto&, const auto& answer) {
    EXPECT_TRUE(absl::IsResourceExhausted(answer.status()));
    ++refused;
  });
  for (int i = 0; i < 6; ++i) ASSERT_TRUE(stream->Send(ReportOf(1)).ok());
  EXPECT_TRUE(stream->Finish().ok());
  EXPECT_EQ(refused, 6);
  EXPECT_EQ(reports, 6);
}

TEST(OutcomeStreamTest, AStreamOfOutcomesWhoseReportIsPostponedForTooLongEndsWithTheReason) {
  TestServer server;
  server.on_stream_outcomes = [](OutcomeServerStream* stream) {
    v1::StreamOutcomesRequest request;
    while (stream->Read(&request)) stream->Write(Postponed());
    return grpc::Status::OK;
  };
  ClientOptions options = OptionsFor(server.address());
  options.upload_patience = absl::Milliseconds(200);
  const auto client = Client::Connect(options);
  ASSERT_TRUE(client.ok()) << client.status();
  int answers = 0;
  const auto stream = (*client)->StreamOutcomes([&](const auto&, const auto&) { ++answers; });
  stream->Send(ReportOf(1)).IgnoreError();
  const absl::Status end = stream->Finish();
  EXPECT_TRUE(absl::IsResourceExhausted(end)) << end;
  EXPECT_EQ(ErrorDetailsOf(end).reason, "TOO_MANY_REQUESTS");
  EXPECT_EQ(answers, 0);
}

TEST(OutcomeStreamTest, PatienceWithPostponedReportsBeginsAnewAfterAnAnswer) {
  TestServer server;
  std::set<int> postponed;  // the first report and the fifth, once each
  server.on_stream_outcomes = [&](OutcomeServerStream* stream) {
    v1::StreamOutcomesRequest request;
    while (stream->Read(&request)) {
      const int outcomes = request.report().outcomes_size();
      if (outcomes % 4 == 1 && postponed.insert(outcomes).second) {
        stream->Write(Postponed(absl::Milliseconds(300)));
      } else {
        AnswerReport(request.report(), stream);
      }
    }
    return grpc::Status::OK;
  };
  ClientOptions options = OptionsFor(server.address());
  options.upload_patience = absl::Milliseconds(500);  // for one delay, but not for two
  const auto client = Client::Connect(options);
  ASSERT_TRUE(client.ok()) << client.status();
  int answers = 0;
  const auto on_answer = [&](const auto&, const auto& answer) { answers += answer.ok() ? 1 : 0; };
  const auto stream = (*client)->StreamOutcomes(on_answer);
  for (int i = 1; i <= 8; ++i) ASSERT_TRUE(stream->Send(ReportOf(i)).ok());
  const absl::Status end = stream->Finish();
  EXPECT_TRUE(end.ok()) << end;
  EXPECT_EQ(answers, 8);
  EXPECT_EQ(postponed.size(), 2U);
}

TEST(OutcomeStreamTest, APostponedReportWaitsForTheFirstBackoffAtLeast) {
  TestServer server;
  server.on_stream_outcomes = [](OutcomeServerStream* stream) {
    v1::StreamOutcomesRequest request;
    for (int times = 1; stream->Read(&request); ++times) {
      if (times <= 3) {
        stream->Write(Postponed(absl::ZeroDuration()));
      } else {
        AnswerReport(request.report(), stream);
      }
    }
    return grpc::Status::OK;
  };
  ClientOptions options = OptionsFor(server.address());
  options.retry.initial_backoff = absl::Milliseconds(30);
  std::vector<absl::Duration> waits;
  options.on_retry = [&](const absl::Status&, absl::Duration wait) { waits.push_back(wait); };
  const auto client = Client::Connect(options);
  ASSERT_TRUE(client.ok()) << client.status();
  const auto stream = (*client)->StreamOutcomes(nullptr);
  stream->Send(ReportOf(1)).IgnoreError();
  EXPECT_TRUE(stream->Finish().ok());
  EXPECT_EQ(waits, std::vector<absl::Duration>(3, absl::Milliseconds(30)));
}

TEST(OutcomeStreamTest, AStreamOfOutcomesEndsWithAnErrorThatIsNotRetried) {
  TestServer server;
  server.on_stream_outcomes = [](OutcomeServerStream*) {
    return grpc::Status(grpc::StatusCode::PERMISSION_DENIED, "role");
  };
  const auto client = ConnectTo(server.address());
  const auto stream = client->StreamOutcomes(nullptr);
  stream->Send(ReportOf(1)).IgnoreError();
  EXPECT_TRUE(absl::IsPermissionDenied(stream->Finish()));
  EXPECT_TRUE(absl::IsPermissionDenied(stream->Send(ReportOf(1))));
}

TEST(OutcomeStreamTest, AStreamOfOutcomesDoesNotWaitForeverForAnAnswer) {
  TestServer server;
  server.on_stream_outcomes = [](OutcomeServerStream* stream) {
    v1::StreamOutcomesRequest request;
    while (stream->Read(&request)) {
    }
    return grpc::Status::OK;
  };
  const auto client = ConnectTo(server.address());
  const auto stream = client->StreamOutcomes(nullptr, {.timeout = absl::Milliseconds(50)});
  stream->Send(ReportOf(1)).IgnoreError();
  EXPECT_TRUE(absl::IsDeadlineExceeded(stream->Finish()));
}

TEST(OutcomeStreamTest, AStreamOfOutcomesDoesNotWaitForeverForAServerThatDoesNotRead) {
  std::promise<void> over;
  TestServer server;
  server.on_stream_outcomes = [&](OutcomeServerStream*) {
    over.get_future().wait_for(std::chrono::seconds(10));
    return grpc::Status::OK;
  };
  const auto client = ConnectTo(server.address());
  const auto stream = client->StreamOutcomes(nullptr, {.timeout = absl::Milliseconds(200)});
  v1::ReportOutcomesRequest report = ReportOf(1);
  report.set_model(std::string(16 << 20, 'x'));  // more than gRPC sends unread
  EXPECT_TRUE(absl::IsDeadlineExceeded(stream->Send(report)));
  EXPECT_TRUE(absl::IsDeadlineExceeded(stream->Finish()));
  over.set_value();
}

TEST(OutcomeStreamTest, AStreamOfOutcomesDoesNotWaitForeverForItsEnd) {
  std::promise<void> over;
  std::atomic<bool> has_ended = false;
  TestServer server;
  server.on_stream_outcomes = [&](OutcomeServerStream* stream) {
    v1::StreamOutcomesRequest request;
    while (stream->Read(&request)) AnswerReport(request.report(), stream);
    over.get_future().wait_for(std::chrono::seconds(30));
    has_ended = true;
    return grpc::Status::OK;
  };
  const auto client = ConnectTo(server.address());
  const auto stream = client->StreamOutcomes(nullptr, {.timeout = absl::Seconds(2)});
  EXPECT_TRUE(stream->Send(ReportOf(1)).ok());
  EXPECT_TRUE(stream->Finish().ok());
  EXPECT_FALSE(has_ended);
  over.set_value();
}

TEST(OutcomeStreamTest, ACancelledStreamOfOutcomesEnds) {
  TestServer server;
  Cancellation cancellation;
  server.on_stream_outcomes = [&](OutcomeServerStream* stream) {
    v1::StreamOutcomesRequest request;
    stream->Read(&request);
    cancellation.Cancel();
    while (stream->Read(&request)) {
    }
    return grpc::Status::CANCELLED;
  };
  const auto client = ConnectTo(server.address());
  const auto stream = client->StreamOutcomes(nullptr, {.cancellation = &cancellation});
  stream->Send(ReportOf(1)).IgnoreError();
  EXPECT_TRUE(absl::IsCancelled(stream->Finish()));
}

}  // namespace
}  // namespace maneuver::client::outcome_stream_test
