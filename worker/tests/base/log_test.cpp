#include "base/log.h"

#include <gtest/gtest.h>

#include <regex>

namespace metrofarm {
namespace {

std::string line_of(LogFormat format, Severity severity, std::string_view message,
                    const LogAttributes& attributes) {
  std::string line;
  Log log("worker", format, [&](std::string_view l) { line += l; }, {{"host.name", "h"}});
  log.write(severity, message, attributes);
  return line;
}

TEST(Log, TextIsForPeople) {
  EXPECT_EQ(line_of(LogFormat::kText, Severity::kWarn, "lost", {}), "worker: lost\n");
  EXPECT_EQ(line_of(LogFormat::kText, Severity::kInfo, "lost", {{"a", "1"}, {"b", "2"}}),
            "worker: lost (a=1, b=2)\n");
  EXPECT_EQ(line_of(LogFormat::kText, Severity::kDebug, "detail", {}), "");
}

TEST(Log, JsonHasOpenTelemetrysNames) {
  const std::string line =
      line_of(LogFormat::kJson, Severity::kWarn, "lost \"it\"", {{"metrofarm.job", "j\n1"}});
  const std::regex expected(
      R"(\{"timestamp":"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{6}Z","severity_text":"WARN",)"
      R"("severity_number":13,"body":"lost \\"it\\"","attributes":\{"metrofarm.job":"j\\u000a1"\},)"
      R"("resource":\{"service.name":"worker","host.name":"h"\}\}\n)");
  EXPECT_TRUE(std::regex_match(line, expected)) << line;
}

TEST(JsonString, KeepsTextAndReplacesWhatIsNoUtf8) {
  EXPECT_EQ(json_string("plain"), "\"plain\"");
  EXPECT_EQ(json_string("\xc3\xa9 \xe2\x82\xac \xf0\x9f\x98\x80"),
            "\"\xc3\xa9 \xe2\x82\xac \xf0\x9f\x98\x80\"");
  EXPECT_EQ(json_string("a\\b\t"), "\"a\\\\b\\u0009\"");
  const std::string bad = "\"\xef\xbf\xbd\"";
  EXPECT_EQ(json_string("\xff"), bad);
  EXPECT_EQ(json_string("\xc3"), bad) << "cut off";
  EXPECT_EQ(json_string("\xc0\xaf"), "\"\xef\xbf\xbd\xef\xbf\xbd\"") << "overlong";
  EXPECT_EQ(json_string("\xed\xa0\x80").substr(0, 4), bad.substr(0, 4)) << "surrogate";
}

}  // namespace
}  // namespace metrofarm
