#include "tests/integration/raw_http2.h"

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cstdint>

namespace maneuver::integration {
namespace {

constexpr size_t kFrameHeader = 9;
// Frame types, RFC 9113, section 6.
constexpr int kData = 0;
constexpr int kHeaders = 1;
constexpr int kReset = 3;
constexpr int kSettings = 4;
constexpr int kPing = 6;
constexpr int kWindowUpdate = 8;
constexpr int kInitialWindowSize = 4;  // of a setting
constexpr int kAck = 1;
constexpr int kEndStream = 1;
constexpr int kEndHeaders = 4;

std::string BigEndian(uint32_t value, int bytes) {
  std::string text;
  for (int i = bytes - 1; i >= 0; --i) text += static_cast<char>(value >> (8 * i) & 0xff);
  return text;
}

int64_t Number(const std::string& big_endian) {
  int64_t number = 0;
  for (const char byte : big_endian) number = number << 8 | static_cast<uint8_t>(byte);
  return number;
}

// Returns a header that is neither compressed nor indexed (RFC 7541, 6.2.2). Name and value must be
// shorter than 127.
std::string Header(const std::string& name, const std::string& value) {
  return BigEndian(0, 1) + BigEndian(static_cast<uint32_t>(name.size()), 1) + name +
         BigEndian(static_cast<uint32_t>(value.size()), 1) + value;
}

}  // namespace

RawHttp2::RawHttp2(const std::string& address, std::optional<int> receive_buffer)
    : descriptor_(socket(AF_INET, SOCK_STREAM, 0)) {
  if (receive_buffer.has_value()) {
    const int bytes = *receive_buffer;
    EXPECT_EQ(setsockopt(descriptor_, SOL_SOCKET, SO_RCVBUF, &bytes, sizeof bytes), 0);
  }
  sockaddr_in peer{};
  peer.sin_family = AF_INET;
  peer.sin_port = htons(static_cast<uint16_t>(std::stoi(address.substr(address.rfind(':') + 1))));
  peer.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  EXPECT_EQ(connect(descriptor_, reinterpret_cast<const sockaddr*>(&peer), sizeof peer), 0);
}

RawHttp2::~RawHttp2() { close(descriptor_); }

void RawHttp2::Send(const std::string& bytes) {
  // The server may have closed the connection; the next read will show it.
  (void)!send(descriptor_, bytes.data(), bytes.size(), MSG_NOSIGNAL);
}

void RawHttp2::SendFrame(int type, int flags, int stream, const std::string& payload) {
  Send(BigEndian(static_cast<uint32_t>(payload.size()), 3) + static_cast<char>(type) +
       static_cast<char>(flags) + BigEndian(static_cast<uint32_t>(stream), 4) + payload);
}

void RawHttp2::SendPreface() { Send("PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n"); }

void RawHttp2::SendSettings() { SendFrame(kSettings, 0, 0, ""); }

void RawHttp2::SendSettingsWithoutFlowControl() {
  constexpr uint32_t kLargest = 0x7fffffff;
  constexpr uint32_t kInitial = 65535;  // of the connection, which settings do not change
  SendFrame(kSettings, 0, 0, BigEndian(kInitialWindowSize, 2) + BigEndian(kLargest, 4));
  SendFrame(kWindowUpdate, 0, 0, BigEndian(kLargest - kInitial, 4));
}

void RawHttp2::OpenCall(int stream, const std::string& method, int filling,
                        const std::string& timeout) {
  std::string more;
  if (!timeout.empty()) more += Header("grpc-timeout", timeout);
  for (int i = 0; i < filling; ++i)
    more += Header("x-filling-" + std::to_string(i), std::string(84, 'f'));
  SendFrame(kHeaders, kEndHeaders, stream,
            Header(":method", "POST") + Header(":scheme", "http") + Header(":path", method) +
                Header(":authority", "localhost") + Header("te", "trailers") +
                Header("content-type", "application/grpc") + more);
}

void RawHttp2::SendMessage(int stream, const std::string& message, size_t declared) {
  SendFrame(kData, 0, stream,
            BigEndian(0, 1) + BigEndian(static_cast<uint32_t>(declared), 4) + message);
}

void RawHttp2::BeginMessage(int stream, int64_t declared) {
  const std::string header = BigEndian(0, 1) + BigEndian(static_cast<uint32_t>(declared), 4);
  SendFrame(kData, 0, stream, header);
  window_ -= static_cast<int64_t>(header.size());
  parts_[stream] = {.left = declared - 1, .window = -static_cast<int64_t>(header.size())};
  SendMore();
}

void RawHttp2::SendMore() {
  constexpr int64_t kFrame = 16384;
  for (auto& [stream, part] : parts_) {
    for (;;) {
      const int64_t bytes = std::min({kFrame, part.left, window_, first_window_ + part.window});
      if (bytes <= 0) break;
      SendFrame(kData, 0, stream, std::string(static_cast<size_t>(bytes), '\0'));
      part.left -= bytes;
      part.window -= bytes;
      window_ -= bytes;
    }
  }
}

RawHttp2::Received RawHttp2::Read(int messages, std::chrono::milliseconds patience,
                                  bool answers_pings) {
  Received received;
  const auto end = std::chrono::steady_clock::now() + patience;
  while (received.messages < messages) {
    const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(
        end - std::chrono::steady_clock::now());
    pollfd readable{.fd = descriptor_, .events = POLLIN, .revents = 0};
    if (left.count() <= 0 || poll(&readable, 1, static_cast<int>(left.count())) == 0) break;
    char buffer[65536];
    const ssize_t count = recv(descriptor_, buffer, sizeof buffer, 0);
    if (count <= 0) {
      received.closed = true;
      break;
    }
    unread_.append(buffer, static_cast<size_t>(count));
    while (unread_.size() >= kFrameHeader) {
      const auto byte = [this](size_t i) { return static_cast<uint8_t>(unread_[i]); };
      const size_t length = size_t{byte(0)} << 16 | size_t{byte(1)} << 8 | byte(2);
      if (unread_.size() < kFrameHeader + length) break;
      const int type = byte(3);
      const int flags = byte(4);
      const auto stream = static_cast<int>(Number(unread_.substr(5, 4)));
      const std::string payload = unread_.substr(kFrameHeader, length);
      unread_.erase(0, kFrameHeader + length);
      if (type == kData && length > 0) ++received.messages;
      if (type == kHeaders) received.headers += payload;
      if (type == kReset || ((type == kData || type == kHeaders) && (flags & kEndStream) != 0)) {
        ++received.ended;
        parts_.erase(stream);
      }
      if (type == kWindowUpdate && stream == 0) window_ += Number(payload);
      if (type == kWindowUpdate && parts_.contains(stream)) {
        parts_[stream].window += Number(payload);
      }
      for (size_t i = 0; type == kSettings && i + 6 <= length; i += 6) {
        if (Number(payload.substr(i, 2)) != kInitialWindowSize) continue;
        first_window_ = Number(payload.substr(i + 2, 4));
      }
      if (type == kSettings && (flags & kAck) == 0) SendFrame(kSettings, kAck, 0, "");
      if (type == kPing && (flags & kAck) == 0 && answers_pings) SendFrame(kPing, kAck, 0, payload);
    }
  }
  return received;
}

}  // namespace maneuver::integration
