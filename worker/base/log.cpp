#include "base/log.h"

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <ctime>

namespace metrofarm {
namespace {

struct SeverityName {
  const char* text;
  int number;  // OpenTelemetry's SeverityNumber
};

SeverityName name_of(Severity severity) {
  switch (severity) {
    case Severity::kDebug:
      return {"DEBUG", 5};
    case Severity::kInfo:
      return {"INFO", 9};
    case Severity::kWarn:
      return {"WARN", 13};
    case Severity::kError:
      break;
  }
  return {"ERROR", 17};
}

// RFC 3339, UTC, microseconds.
std::string timestamp() {
  using namespace std::chrono;
  const auto now = system_clock::now();
  const std::time_t seconds = system_clock::to_time_t(now);
  const auto micros = duration_cast<microseconds>(now.time_since_epoch()).count() % 1000000;
  std::tm utc{};
  gmtime_r(&seconds, &utc);
  char date[32], out[48];
  std::strftime(date, sizeof date, "%Y-%m-%dT%H:%M:%S", &utc);
  std::snprintf(out, sizeof out, "%s.%06dZ", date, static_cast<int>(micros));
  return out;
}

std::string json_object(const LogAttributes& attributes) {
  std::string out = "{";
  for (const auto& [name, value] : attributes) {
    if (out.size() > 1) out += ',';
    out += json_string(name) + ":" + json_string(value);
  }
  return out + "}";
}

// Length of the UTF-8 sequence at the start of text; 0 if there is none.
size_t utf8_length(std::string_view text) {
  const auto byte = [&](size_t i) { return static_cast<unsigned char>(text[i]); };
  const unsigned char first = byte(0);
  if (first < 0x80) return 1;
  const size_t length = first >= 0xf0 ? 4 : first >= 0xe0 ? 3 : 2;
  if (first < 0xc2 || first > 0xf4 || text.size() < length) return 0;
  for (size_t i = 1; i < length; ++i)
    if ((byte(i) & 0xc0) != 0x80) return 0;
  // Overlong forms, surrogates and what lies beyond U+10FFFF.
  const unsigned char second = byte(1);
  const bool wrong = (first == 0xe0 && second < 0xa0) || (first == 0xed && second > 0x9f) ||
                     (first == 0xf0 && second < 0x90) || (first == 0xf4 && second > 0x8f);
  return wrong ? 0 : length;
}

}  // namespace

std::string json_string(std::string_view text) {
  std::string out = "\"";
  while (!text.empty()) {
    const auto c = static_cast<unsigned char>(text[0]);
    const size_t length = utf8_length(text);
    if (length == 0) {
      out += "\xef\xbf\xbd";
    } else if (c == '"' || c == '\\') {
      out += {'\\', text[0]};
    } else if (c < 0x20 || c == 0x7f) {
      char escape[8];
      std::snprintf(escape, sizeof escape, "\\u%04x", c);
      out += escape;
    } else {
      out += text.substr(0, length);
    }
    text.remove_prefix(std::max<size_t>(length, 1));
  }
  return out + "\"";
}

Log::Log(std::string service, LogFormat format, Sink sink, LogAttributes resource)
    : service_(std::move(service)), format_(format), sink_(std::move(sink)) {
  resource.insert(resource.begin(), {"service.name", service_});
  resource_ = json_object(resource);
}

void Log::write(Severity severity, std::string_view message, const LogAttributes& attributes) {
  if (format_ == LogFormat::kText && severity == Severity::kDebug) return;
  const std::string line =
      format_ == LogFormat::kText ? text(message, attributes) : json(severity, message, attributes);
  const std::lock_guard lock(mutex_);
  sink_(line);
}

std::string Log::text(std::string_view message, const LogAttributes& attributes) const {
  std::string out = service_ + ": " + std::string(message);
  const char* separator = " (";
  for (const auto& [name, value] : attributes) {
    out += separator + std::string(name) + "=" + value;
    separator = ", ";
  }
  return out + (attributes.empty() ? "\n" : ")\n");
}

std::string Log::json(Severity severity, std::string_view message,
                      const LogAttributes& attributes) const {
  const SeverityName name = name_of(severity);
  return "{\"timestamp\":\"" + timestamp() + "\",\"severity_text\":\"" + name.text +
         "\",\"severity_number\":" + std::to_string(name.number) +
         ",\"body\":" + json_string(message) + ",\"attributes\":" + json_object(attributes) +
         ",\"resource\":" + resource_ + "}\n";
}

}  // namespace metrofarm
