// Structured log lines on standard error, as text or JSON. Fields never contain payloads, tokens or
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

// Sets format and level. Before the first call: text, info and above. May be called at any time.
void ConfigureLogging(LogFormat format, LogLevel level);

// Gets or sets the lowest level that is logged. Safe at any time.
LogLevel GetLogLevel();
void SetLogLevel(LogLevel level);

// Returns "debug", for example.
std::string_view ToString(LogLevel level);

// Returns whether a line of this level would be written, so that callers can skip costly fields.
bool WouldLog(LogLevel level);

// Writes one line: time, level, `message` (a constant phrase), fields.
void Log(LogLevel level, std::string_view message, std::initializer_list<LogField> fields = {});

// Returns the part of a line after time and level, as Log writes it.
std::string FormatLogLine(LogFormat format, std::string_view message,
                          std::initializer_list<LogField> fields);

}  // namespace maneuver::monitoring

#endif  // MANEUVER_SERVER_MONITORING_LOGGING_H_
