#ifndef MANEUVER_TESTS_INTEGRATION_RAW_HTTP2_H_
#define MANEUVER_TESTS_INTEGRATION_RAW_HTTP2_H_

#include <chrono>
#include <string>

namespace maneuver::integration {

// A client that speaks just enough HTTP/2 (RFC 9113) to behave as no library would: it says half of
// what it should, or nothing, and reads nothing unless told to. In plain text, over loopback.
class RawHttp2 {
 public:
  // Connects, and is silent.
  explicit RawHttp2(const std::string& address);
  ~RawHttp2();
  RawHttp2(const RawHttp2&) = delete;
  RawHttp2& operator=(const RawHttp2&) = delete;

  // The magic words of a client.
  void SendPreface();
  void SendSettings();
  // Settings and windows that let the server send as much as it likes.
  void SendSettingsWithoutFlowControl();
  // Opens the call of a method, "/package.Service/Method", without a message.
  //   stream: 1, 3, 5, ...
  void OpenCall(int stream, const std::string& method);
  // The whole of a message of at most 16 kB; `declared` is the length that its header tells.
  void SendMessage(int stream, const std::string& message, size_t declared);
  void SendMessage(int stream, const std::string& message) {
    SendMessage(stream, message, message.size());
  }

  // What has come of an answer.
  struct Received {
    int messages = 0;     // frames of data
    int ended = 0;        // streams
    bool closed = false;  // the connection
  };
  // Reads until so many frames of data came, or the connection was closed, or time is up.
  //   answers_pings: as a client should; settings are acknowledged either way.
  Received Read(int messages, std::chrono::milliseconds patience, bool answers_pings);

 private:
  void Send(const std::string& bytes);
  void SendFrame(int type, int flags, int stream, const std::string& payload);

  int descriptor_ = -1;
  std::string unread_;  // the start of a frame
};

}  // namespace maneuver::integration

#endif  // MANEUVER_TESTS_INTEGRATION_RAW_HTTP2_H_
