#ifndef MANEUVER_TESTS_INTEGRATION_RAW_HTTP2_H_
#define MANEUVER_TESTS_INTEGRATION_RAW_HTTP2_H_

#include <chrono>
#include <cstdint>
#include <map>
#include <optional>
#include <string>

namespace maneuver::integration {

// A client with just enough HTTP/2 (RFC 9113) to behave as no library does: it sends only half of
// what it should, or nothing, and reads nothing unless told to. In plain text, over loopback.
class RawHttp2 {
 public:
  // Connects and sends nothing.
  //   receive_buffer: bytes of answers that the kernel keeps unread, about; its default without
  explicit RawHttp2(const std::string& address, std::optional<int> receive_buffer = std::nullopt);
  ~RawHttp2();
  RawHttp2(const RawHttp2&) = delete;
  RawHttp2& operator=(const RawHttp2&) = delete;

  // Sends the bytes with which a client begins a connection.
  void SendPreface();
  void SendSettings();
  // Sends settings and windows that let the server send any amount.
  void SendSettingsWithoutFlowControl();
  // Opens a call of a method, "/package.Service/Method", without a message.
  //   stream: 1, 3, 5, ...
  //   filling: number of meaningless headers of 100 bytes, sent beside the call's own; at most 130
  //   timeout: of the call, such as 99999999H
  void OpenCall(int stream, const std::string& method, int filling = 0,
                const std::string& timeout = "");
  // Sends a complete message of at most 16 kB.
  //   declared: the length that its header states
  void SendMessage(int stream, const std::string& message, size_t declared);
  void SendMessage(int stream, const std::string& message) {
    SendMessage(stream, message, message.size());
  }

  // Sends the header of a message, and then as many of its bytes as the server's windows let in.
  //   declared: the length that the header states; all but the last byte are sent
  void BeginMessage(int stream, int64_t declared);
  // Sends more of the messages that were begun, as far as the windows that Read has seen let in.
  void SendMore();
  // Returns how many streams with a message that was begun have not ended, as far as Read has seen.
  size_t begun() const { return parts_.size(); }

  // The part of an answer that has arrived.
  struct Received {
    int messages = 0;     // frames of data
    int ended = 0;        // streams
    std::string headers;  // blocks of headers and trailers, as they were encoded
    bool closed = false;  // the connection
  };
  // Reads until `messages` data frames have arrived, the connection is closed, or the time is up.
  //   answers_pings: as a client should. Settings are acknowledged either way.
  Received Read(int messages, std::chrono::milliseconds patience, bool answers_pings);

 private:
  void Send(const std::string& bytes);
  void SendFrame(int type, int flags, int stream, const std::string& payload);

  // A message that was begun.
  struct Part {
    int64_t left = 0;    // bytes that were not sent
    int64_t window = 0;  // what the server lets the stream send, besides the first window
  };

  int descriptor_ = -1;
  std::string unread_;  // the start of a frame
  // Bytes that the server lets in: of the connection, and of a stream at its begin.
  int64_t window_ = 65535;
  int64_t first_window_ = 65535;
  std::map<int, Part> parts_;  // by stream
};

}  // namespace maneuver::integration

#endif  // MANEUVER_TESTS_INTEGRATION_RAW_HTTP2_H_
