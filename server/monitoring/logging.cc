#include "server/monitoring/logging.h"

#include <spdlog/sinks/stdout_sinks.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <memory>

#include "model/files/utf8.h"

namespace maneuver::monitoring {
namespace {

spdlog::level::level_enum ToSpdlog(LogLevel level) {
  switch (level) {
    case LogLevel::kDebug:
      return spdlog::level::debug;
    case LogLevel::kInfo:
      return spdlog::level::info;
    case LogLevel::kWarning:
      return spdlog::level::warn;
    case LogLevel::kError:
      return spdlog::level::err;
  }
  return spdlog::level::info;
}

constexpr char kTextPattern[] = "%Y-%m-%dT%H:%M:%S.%eZ %-7l %v";
constexpr char kJsonPattern[] = R"({"time":"%Y-%m-%dT%H:%M:%S.%eZ","level":"%l",%v})";

// One logger per format, so that writing a line needs no lock against a change of format.
struct Loggers {
  Loggers() {
    auto sink = std::make_shared<spdlog::sinks::stderr_sink_mt>();
    auto json_sink = std::make_shared<spdlog::sinks::stderr_sink_mt>();
    text = std::make_shared<spdlog::logger>("text", std::move(sink));
    json = std::make_shared<spdlog::logger>("json", std::move(json_sink));
    text->set_pattern(kTextPattern, spdlog::pattern_time_type::utc);
    json->set_pattern(kJsonPattern, spdlog::pattern_time_type::utc);
    // The loggers pass everything; the level below decides.
    text->set_level(spdlog::level::trace);
    json->set_level(spdlog::level::trace);
    text->flush_on(spdlog::level::debug);
    json->flush_on(spdlog::level::debug);
  }

  std::shared_ptr<spdlog::logger> text;
  std::shared_ptr<spdlog::logger> json;
  std::atomic<LogFormat> format = LogFormat::kText;
  std::atomic<LogLevel> level = LogLevel::kInfo;
};

Loggers& GetLoggers() {
  static auto& loggers = *new Loggers;  // never destroyed: threads may log during exit
  return loggers;
}

// Appends text so that it is valid JSON between quotes and does nothing to a terminal. Bytes that are
// not UTF-8 become U+FFFD.
void AppendEscaped(std::string& out, std::string_view text) {
  while (!text.empty()) {
    const size_t length = files::Utf8Length(text);
    const std::string_view character = text.substr(0, std::max<size_t>(length, 1));
    if (length == 0) {
      out += "\\ufffd";
    } else if (character == "\"" || character == "\\") {
      out += '\\';
      out += character;
    } else if (character == "\n") {
      out += "\\n";
    } else if (files::IsControlCharacter(character)) {
      // The second byte of U+0080 to U+009F is their code.
      out += fmt::format("\\u{:04x}",
                         static_cast<unsigned>(static_cast<unsigned char>(character.back())));
    } else {
      out += character;
    }
    text.remove_prefix(character.size());
  }
}

void AppendQuoted(std::string& out, std::string_view text) {
  out += '"';
  AppendEscaped(out, text);
  out += '"';
}

bool NeedsQuotes(std::string_view text) {
  return text.empty() || std::ranges::any_of(text, [](char c) {
           const auto byte = static_cast<unsigned char>(c);
           return byte <= ' ' || byte >= 0x7f || c == '"' || c == '\\' || c == '=';
         });
}

void AppendValue(std::string& out, LogFormat format, const LogField& field) {
  if (const auto* text = std::get_if<std::string_view>(&field.value)) {
    if (format == LogFormat::kJson || NeedsQuotes(*text)) {
      AppendQuoted(out, *text);
    } else {
      out += *text;
    }
  } else if (const auto* flag = std::get_if<bool>(&field.value)) {
    out += *flag ? "true" : "false";
  } else if (const auto* integer = std::get_if<int64_t>(&field.value)) {
    out += fmt::format("{}", *integer);
  } else {
    const double number = std::get<double>(field.value);
    // JSON has no NaN.
    out += format == LogFormat::kJson && !std::isfinite(number) ? "null"
                                                                : fmt::format("{:.6g}", number);
  }
}

}  // namespace

void ConfigureLogging(LogFormat format, LogLevel level) {
  GetLoggers().format = format;
  SetLogLevel(level);
}

LogLevel GetLogLevel() { return GetLoggers().level; }

void SetLogLevel(LogLevel level) { GetLoggers().level = level; }

std::string_view ToString(LogLevel level) {
  switch (level) {
    case LogLevel::kDebug:
      return "debug";
    case LogLevel::kInfo:
      return "info";
    case LogLevel::kWarning:
      return "warning";
    case LogLevel::kError:
      return "error";
  }
  return "unknown";
}

bool WouldLog(LogLevel level) { return level >= GetLogLevel(); }

std::string FormatLogLine(LogFormat format, std::string_view message,
                          std::initializer_list<LogField> fields) {
  std::string line;
  if (format == LogFormat::kJson) {
    line += "\"message\":";
    AppendQuoted(line, message);
    for (const LogField& field : fields) {
      line += ',';
      AppendQuoted(line, field.key);
      line += ':';
      AppendValue(line, format, field);
    }
  } else {
    AppendEscaped(line, message);
    for (const LogField& field : fields) {
      line += ' ';
      line += field.key;
      line += '=';
      AppendValue(line, format, field);
    }
  }
  return line;
}

void Log(LogLevel level, std::string_view message, std::initializer_list<LogField> fields) {
  if (!WouldLog(level)) return;
  Loggers& loggers = GetLoggers();
  const LogFormat format = loggers.format;
  spdlog::logger& logger = format == LogFormat::kJson ? *loggers.json : *loggers.text;
  const std::string line = FormatLogLine(format, message, fields);
  logger.log(ToSpdlog(level), spdlog::string_view_t(line));
}

}  // namespace maneuver::monitoring
