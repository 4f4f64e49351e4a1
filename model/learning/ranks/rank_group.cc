#include "model/learning/ranks/rank_group.h"

#include <algorithm>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <thread>
#include <torch/csrc/distributed/c10d/PrefixStore.hpp>
#include <torch/csrc/distributed/c10d/ProcessGroupGloo.hpp>
#include <torch/csrc/distributed/c10d/TCPStore.hpp>
#include <utility>

#include "absl/strings/str_cat.h"
#include "model/learning/training_failure.h"

namespace maneuver::learning {
namespace {

using std::chrono::milliseconds;
using std::chrono::steady_clock;
using Store = c10::intrusive_ptr<c10d::Store>;

constexpr int64_t kNoteBytes = 4096;
constexpr size_t kMostMessage = 512;  // bytes of an error in a note
constexpr milliseconds kPoll{20};
constexpr milliseconds kBeat{500};

// The network device that the ranks reach each other by: GLOO_SOCKET_IFNAME names one. Else
// loopback, if the store is there, or that of this machine's name.
std::shared_ptr<::gloo::transport::Device> MakeDevice(const std::string& host) {
  if (const char* const name = std::getenv("GLOO_SOCKET_IFNAME"); name != nullptr && *name != 0) {
    return c10d::ProcessGroupGloo::createDeviceForInterface(name);
  }
  if (host == "127.0.0.1" || host == "localhost" || host == "::1") {
    return c10d::ProcessGroupGloo::createDeviceForHostname(host);
  }
  return c10d::ProcessGroupGloo::createDefaultDevice();
}

std::string Explain(const std::exception& error) {
  const auto* const known = dynamic_cast<const c10::Error*>(&error);
  std::string what = known != nullptr ? known->what_without_backtrace() : error.what();
  // Gloo begins with its source's path and line.
  if (what.starts_with('[')) what.erase(0, std::min(what.size(), what.find("] ") + 2));
  return what.substr(0, what.find('\n')).substr(0, kMostMessage);
}

absl::Status Lost(const std::string& message) {
  return WithFailure(absl::UnavailableError(message), TrainingFailure::kRankLost);
}

// Serves the store or connects to it. Nobody may serve it yet.
c10::intrusive_ptr<c10d::TCPStore> OpenStore(const RankPlace& place, milliseconds timeout,
                                             const std::function<bool()>& stopped) {
  constexpr milliseconds kAttempt{2'000};
  c10d::TCPStoreOptions options;
  options.port = static_cast<uint16_t>(place.port);
  options.isServer = place.rank == 0 && place.serves_store;
  options.waitWorkers = false;
  options.timeout = std::min(timeout, kAttempt);
  const steady_clock::time_point last = steady_clock::now() + timeout;
  for (;;) {
    try {
      auto store = c10::make_intrusive<c10d::TCPStore>(place.host, options);
      store->setTimeout(timeout);
      return store;
    } catch (const std::exception&) {
      if (options.isServer || stopped() || steady_clock::now() > last) throw;
    }
    std::this_thread::sleep_for(kPoll);
  }
}

// Waits until all ranks have come to the store.
absl::Status Meet(c10d::Store& store, const RankPlace& place, milliseconds timeout,
                  const std::function<bool()>& stopped) {
  const std::string all = "all";
  if (store.add("arrived", 1) == place.ranks) store.set(all, std::vector<uint8_t>{1});
  const steady_clock::time_point last = steady_clock::now() + timeout;
  while (!store.check({all})) {
    if (stopped()) return absl::CancelledError("training was stopped");
    if (steady_clock::now() > last) {
      return Lost(absl::StrCat("rank ", place.rank, " waited ", timeout.count() / 1000, " s at ",
                               place.host, ":", place.port, ", but only ", store.add("arrived", 0),
                               " of ", place.ranks,
                               " ranks came; see why the others did not start"));
    }
    std::this_thread::sleep_for(kPoll);
  }
  return absl::OkStatus();
}

class Server final : public RankStore {
 public:
  explicit Server(c10::intrusive_ptr<c10d::TCPStore> store) : store_(std::move(store)) {}
  int port() const override { return store_->getPort(); }

 private:
  c10::intrusive_ptr<c10d::TCPStore> store_;
};

}  // namespace

class RankGroup::Connection {
 public:
  Connection(const Store& store, const RankPlace& place, milliseconds timeout) : store_(store) {
    auto options = c10d::ProcessGroupGloo::Options::create(timeout);
    options->devices.push_back(MakeDevice(place.host));
    options->threads = 1;
    gloo_ = c10::make_intrusive<c10d::ProcessGroupGloo>(store_, place.rank, place.ranks, options);
  }

  void Broadcast(at::Tensor tensor) const {
    std::vector<at::Tensor> tensors = {std::move(tensor)};
    gloo_->broadcast(tensors)->wait();
  }

  // Gathers the ranks' tensors into the rows of `all`, [n, ...].
  void Gather(const at::Tensor& mine, const at::Tensor& all) const {
    std::vector<std::vector<at::Tensor>> outputs = {all.unbind(0)};
    std::vector<at::Tensor> inputs = {mine};
    gloo_->allgather(outputs, inputs)->wait();
  }

  // Gives row i of `mine` to rank i; row i of `theirs` comes from rank i. Both [n, ...].
  void Deal(at::Tensor mine, at::Tensor theirs) const {
    std::vector<int64_t> even;
    gloo_->alltoall_base(theirs, mine, even, even)->wait();
  }

 private:
  const Store store_;
  c10::intrusive_ptr<c10d::ProcessGroupGloo> gloo_;
};

RankGroup::RankGroup(std::function<bool()> stopped) : stopped_(std::move(stopped)) {}

RankGroup::~RankGroup() = default;

absl::StatusOr<std::unique_ptr<RankGroup>> RankGroup::Join(const RankPlace& place,
                                                           milliseconds timeout,
                                                           milliseconds join_timeout,
                                                           std::function<bool()> stopped) {
  auto group = std::make_unique<RankGroup>(std::move(stopped));
  if (place.ranks == 1) return group;
  try {
    const Store store = c10::make_intrusive<c10d::PrefixStore>(
        absl::StrCat("maneuver/", place.attempt), OpenStore(place, join_timeout, group->stopped_));
    const absl::Status met = Meet(*store, place, join_timeout, group->stopped_);
    if (!met.ok()) return met;
    group->connection_ = std::make_unique<Connection>(store, place, timeout);
  } catch (const std::exception& error) {
    if (group->stopped_()) return absl::CancelledError("training was stopped");
    return Lost(absl::StrCat("rank ", place.rank, " of ", place.ranks,
                             " cannot join the others at ", place.host, ":", place.port, ": ",
                             Explain(error)));
  }
  group->rank_ = place.rank;
  group->size_ = place.ranks;
  group->timeout_ = timeout;
  return group;
}

absl::Status RankGroup::Guard(const std::function<void()>& exchange) {
  if (!lost_.ok()) return lost_;
  try {
    exchange();
  } catch (const std::exception& error) {
    heard_stop_ = true;
    lost_ = stopped_() ? absl::CancelledError("training was stopped")
                       : Lost(absl::StrCat(
                             "rank ", rank_, " of ", size_,
                             " lost another rank, which ended or did not answer within ",
                             timeout_.count() / 1000, " s (", Explain(error),
                             "); start all ranks again: they continue from the last checkpoint"));
  }
  return lost_;
}

absl::Status RankGroup::Broadcast(std::string* bytes) {
  if (size_ == 1) return absl::OkStatus();
  return Guard([&] {
    const at::Tensor size = at::tensor({static_cast<int64_t>(bytes->size())}, at::kLong);
    connection_->Broadcast(size);
    bytes->resize(static_cast<size_t>(size.item<int64_t>()));
    connection_->Broadcast(
        at::from_blob(bytes->data(), {static_cast<int64_t>(bytes->size())}, at::kByte));
  });
}

absl::StatusOr<std::vector<RankNote>> RankGroup::Exchange(const RankNote& note) {
  if (size_ == 1) return std::vector<RankNote>{note};
  RankNote sent = note;
  sent.set_stops(stopped_());
  const std::string bytes = sent.SerializeAsString();
  const auto size = static_cast<uint32_t>(bytes.size());
  TORCH_CHECK(sizeof(size) + bytes.size() <= kNoteBytes, "a rank's note has ", size, " bytes");
  const at::Tensor mine = at::zeros({kNoteBytes}, at::kByte);
  std::memcpy(mine.data_ptr<uint8_t>(), &size, sizeof(size));
  std::memcpy(mine.data_ptr<uint8_t>() + sizeof(size), bytes.data(), bytes.size());
  const at::Tensor all = at::empty({size_, kNoteBytes}, at::kByte);
  const absl::Status status = Guard([&] { connection_->Gather(mine, all); });
  if (!status.ok()) return status;
  std::vector<RankNote> notes;
  for (int i = 0; i < size_; ++i) {
    const uint8_t* const row = all.data_ptr<uint8_t>() + i * kNoteBytes;
    uint32_t length = 0;
    std::memcpy(&length, row, sizeof(length));
    TORCH_CHECK(
        sizeof(length) + length <= kNoteBytes &&
            notes.emplace_back().ParseFromArray(row + sizeof(length), static_cast<int>(length)),
        "the note of rank ", i, " is damaged");
  }
  if (std::ranges::any_of(notes, &RankNote::stops)) heard_stop_ = true;
  return notes;
}

absl::Status RankGroup::SumByTree(at::Tensor* values) {
  if (size_ == 1) return absl::OkStatus();
  return Guard([&] {
    // Each rank sums one slice of all.
    const at::Tensor mine = values->cpu().view({size_, -1});
    at::Tensor slices = at::empty_like(mine);
    connection_->Deal(mine, slices);
    for (int64_t count = size_; count > 1; count /= 2) {
      const at::Tensor pairs = slices.view({count / 2, 2, -1});
      slices = pairs.select(1, 0) + pairs.select(1, 1);
    }
    connection_->Gather(slices.flatten(), mine);
    if (!values->is_cpu()) values->copy_(mine.flatten());
  });
}

absl::Status RankGroup::OnRankZero(const std::function<absl::Status()>& work) {
  return Apart([&] { return rank_ == 0 ? work() : absl::OkStatus(); });
}

absl::Status RankGroup::Apart(const std::function<absl::Status()>& work) {
  if (size_ == 1) return work();
  std::promise<absl::Status> outcome;
  absl::Status status;
  std::exception_ptr thrown;
  {
    const std::jthread assuring(
        [&, future = outcome.get_future()]() mutable { status = Assure(std::move(future)); });
    try {
      outcome.set_value(work());
    } catch (...) {  // told to the others, then thrown on
      thrown = std::current_exception();
      outcome.set_value(absl::InternalError("failed; its own last line says why"));
    }
  }
  if (thrown) std::rethrow_exception(thrown);
  return status;
}

absl::Status RankGroup::Assure(std::future<absl::Status> work) {
  const milliseconds beat = std::min(kBeat, timeout_ / 4);
  RankNote note;
  note.set_is_busy(true);
  for (;;) {
    if (note.is_busy() && work.wait_for(beat) == std::future_status::ready) {
      note.set_is_busy(false);
      WriteStatus(work.get(), &note);
    }
    const absl::StatusOr<std::vector<RankNote>> notes = Exchange(note);
    if (!notes.ok()) {
      if (note.is_busy()) work.wait();  // it hears StopRequested
      return notes.status();
    }
    if (std::ranges::none_of(*notes, &RankNote::is_busy)) return FirstError(*notes);
  }
}

void WriteStatus(const absl::Status& status, RankNote* note) {
  if (status.ok()) return;
  note->set_code(static_cast<int>(status.code()));
  note->set_message(std::string(status.message()).substr(0, kMostMessage));
  if (const auto failure = FailureOf(status)) note->set_failure(static_cast<int>(*failure));
}

absl::Status FirstError(const std::vector<RankNote>& notes) {
  for (size_t i = 0; i < notes.size(); ++i) {
    const RankNote& note = notes[i];
    if (note.code() == 0) continue;
    absl::Status status(
        static_cast<absl::StatusCode>(note.code()),
        notes.size() > 1 ? absl::StrCat("rank ", i, ": ", note.message()) : note.message());
    if (note.failure() == 0) return status;
    return WithFailure(std::move(status), static_cast<TrainingFailure>(note.failure()));
  }
  return absl::OkStatus();
}

absl::StatusOr<std::unique_ptr<RankStore>> RankStore::Serve() {
  try {
    c10d::TCPStoreOptions options;
    options.port = 0;
    options.isServer = true;
    options.waitWorkers = false;
    return std::make_unique<Server>(c10::make_intrusive<c10d::TCPStore>("127.0.0.1", options));
  } catch (const std::exception& error) {
    return absl::UnavailableError(
        absl::StrCat("cannot serve the store of the ranks on this machine: ", Explain(error)));
  }
}

}  // namespace maneuver::learning
