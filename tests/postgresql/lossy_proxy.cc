#include "tests/postgresql/lossy_proxy.h"

#include <poll.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <array>
#include <cstdlib>
#include <string>
#include <string_view>
#include <utility>

namespace maneuver::postgresql {
namespace {

sockaddr_un AddressOf(const std::filesystem::path& path) {
  sockaddr_un address = {};
  address.sun_family = AF_UNIX;
  path.string().copy(address.sun_path, sizeof(address.sun_path) - 1);
  return address;
}

bool WriteAll(int socket, std::string_view bytes) {
  while (!bytes.empty()) {
    const ssize_t written = send(socket, bytes.data(), bytes.size(), MSG_NOSIGNAL);
    if (written <= 0) return false;
    bytes.remove_prefix(static_cast<size_t>(written));
  }
  return true;
}

constexpr int kPollMs = 50;

}  // namespace

LossyProxy::LossyProxy(std::filesystem::path server) : server_(std::move(server)) {
  std::string name = (std::filesystem::temp_directory_path() / "maneuver-proxy-XXXXXX").string();
  folder_ = mkdtemp(name.data());
  listener_ = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
  const sockaddr_un address = AddressOf(folder_ / server_.filename());
  bind(listener_, reinterpret_cast<const sockaddr*>(&address), sizeof(address));
  listen(listener_, 4);
  thread_ = std::thread([this] { Serve(); });
}

LossyProxy::~LossyProxy() {
  stops_ = true;
  thread_.join();
  close(listener_);
  std::error_code ignored;
  std::filesystem::remove_all(folder_, ignored);
}

void LossyProxy::Serve() {
  while (!stops_) {
    pollfd ready = {listener_, POLLIN, 0};
    if (poll(&ready, 1, kPollMs) <= 0) continue;
    const int client = accept4(listener_, nullptr, nullptr, SOCK_CLOEXEC);
    if (client < 0) continue;
    Pass(client);
    close(client);
  }
}

void LossyProxy::Pass(int client) {
  const int server = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
  const sockaddr_un address = AddressOf(server_);
  bool passes = connect(server, reinterpret_cast<const sockaddr*>(&address), sizeof(address)) == 0;
  std::array<char, 1 << 16> buffer;
  bool answer_is_lost = false;
  while (passes && !stops_) {
    std::array<pollfd, 2> sockets = {pollfd{client, POLLIN, 0}, pollfd{server, POLLIN, 0}};
    if (poll(sockets.data(), sockets.size(), kPollMs) <= 0) continue;
    for (const auto& [from, to] : {std::pair(client, server), std::pair(server, client)}) {
      if (sockets[from == client ? 0 : 1].revents == 0) continue;
      const ssize_t count = recv(from, buffer.data(), buffer.size(), 0);
      const std::string_view bytes(buffer.data(), count > 0 ? static_cast<size_t>(count) : 0);
      if (from == client && bytes.find("COMMIT") != std::string_view::npos) {
        const Loss loss = next_.exchange(Loss::kNone);
        if (loss != Loss::kNone) ++lost_;
        if (loss == Loss::kRequest) passes = false;
        answer_is_lost = loss == Loss::kAnswer;
      }
      if (from == server && answer_is_lost) passes = false;
      passes = passes && count > 0 && WriteAll(to, bytes);
      if (!passes) break;
    }
  }
  close(server);
}

}  // namespace maneuver::postgresql
