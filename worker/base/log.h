// Lines about what a process does, for people or for collectors of logs.
#pragma once

#include <functional>
#include <mutex>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace metrofarm {

enum class Severity { kDebug, kInfo, kWarn, kError };

enum class LogFormat {
  kText,  // "metrofarm-worker: message (name=value, ...)"; debug lines are left out
  kJson,  // one object per line, with the names of OpenTelemetry's log data model
};

// What a line is about, by name, for example {"metrofarm.job", "j-1"}.
using LogAttributes = std::vector<std::pair<std::string_view, std::string>>;

// Thread-safe; lines never mix.
class Log {
 public:
  // Takes one finished line, with its end.
  using Sink = std::function<void(std::string_view line)>;

  // service: the process's name. resource: what holds for every line.
  Log(std::string service, LogFormat format, Sink sink, LogAttributes resource = {});

  void write(Severity severity, std::string_view message, const LogAttributes& attributes = {});
  void debug(std::string_view m, const LogAttributes& a = {}) { write(Severity::kDebug, m, a); }
  void info(std::string_view m, const LogAttributes& a = {}) { write(Severity::kInfo, m, a); }
  void warn(std::string_view m, const LogAttributes& a = {}) { write(Severity::kWarn, m, a); }
  void error(std::string_view m, const LogAttributes& a = {}) { write(Severity::kError, m, a); }

 private:
  std::string text(std::string_view message, const LogAttributes& attributes) const;
  std::string json(Severity severity, std::string_view message,
                   const LogAttributes& attributes) const;

  std::string service_;
  LogFormat format_;
  Sink sink_;
  std::string resource_;  // as a JSON object
  std::mutex mutex_;
};

// A JSON string with its quotes. Bytes that are no UTF-8 become U+FFFD.
std::string json_string(std::string_view text);

}  // namespace metrofarm
