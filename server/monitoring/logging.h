// Structured log lines on standard error, as text or JSON. Fields never hold payloads, tokens or
// paths of the server.

#ifndef MANEUVER_SERVER_MONITORING_LOGGING_H_
#define MANEUVER_SERVER_MONITORING_LOGGING_H_

#include <concepts>
#include <cstdint>
#include <initializer_list>
#include <string>
#include <string_view>
#include <variant>

namespace maneuver::monitoring {

enum class LogLevel { kDebug, kInfo, kWarning, kError };
enum class LogFormat { kText, kJson };

struct LogField {
  LogField(std::string_view field_key, std::string_view text) : key(field_key), value(text) {}
  LogField(std::string_view field_key, const char* text)
      : key(field_key), value(std::string_view(text)) {}
  LogField(std::string_view field_key, const std::string& text)
      : key(field_key), value(std::string_view(text)) {}
  LogField(std::string_view field_key, bool flag) : key(field_key), value(flag) {}
  LogField(std::string_view field_key, double number) : key(field_key), value(number) {}
  template <std::integral Integer>
  LogField(std::string_view field_key, Integer number)
      : key(field_key), value(static_cast<int64_t>(number)) {}

  std::string_view key;
  std::variant<std::string_view, bool, int64_t, double> value;
};

// Until it is called: text, info and above. May be called again at any time.
void ConfigureLogging(LogFormat format, LogLevel level);

// The least level that is logged. Changed at any time.
LogLevel GetLogLevel();
void SetLogLevel(LogLevel level);

// "debug".
std::string_view ToString(LogLevel level);

// Whether a line of this level would be written: for what is costly to put together.
bool WouldLog(LogLevel level);

// One line: time, level, `message` (a constant phrase), fields.
void Log(LogLevel level, std::string_view message, std::initializer_list<LogField> fields = {});

// The part of a line after time and level; what Log writes.
std::string FormatLogLine(LogFormat format, std::string_view message,
                          std::initializer_list<LogField> fields);

}  // namespace maneuver::monitoring

#endif  // MANEUVER_SERVER_MONITORING_LOGGING_H_
