#include "app/arguments.h"

#include <gtest/gtest.h>

namespace metrofarm::app {
namespace {

Result<Arguments> parse(const std::vector<std::string>& words) {
  return parse_arguments(words, {"threads", "set", "name"}, {"verbose"});
}

TEST(Arguments, TakesBothSpellingsInAnyOrder) {
  const auto a = parse({"scene.xml", "--threads", "4", "--verbose", "--name=x=y", "out"});
  ASSERT_TRUE(a.ok());
  EXPECT_EQ(a.value().positional, (std::vector<std::string>{"scene.xml", "out"}));
  EXPECT_EQ(a.value().get("threads", ""), "4");
  EXPECT_EQ(a.value().get("name", ""), "x=y");
  EXPECT_TRUE(a.value().has("verbose"));
  EXPECT_FALSE(a.value().has("quiet"));
}

TEST(Arguments, TheLastValueWinsAndAbsentOptionsFallBack) {
  const auto a = parse({"--name", "a", "--name", "b"});
  ASSERT_TRUE(a.ok());
  EXPECT_EQ(a.value().get("name", "c"), "b");
  EXPECT_EQ(a.value().get("threads", "c"), "c");
}

TEST(Arguments, UnknownNamesAndMissingValuesAreErrors) {
  const auto unknown = parse({"--thread", "4"});
  ASSERT_FALSE(unknown.ok());
  EXPECT_EQ(unknown.error().message, "unknown option --thread");
  const auto missing = parse({"--threads"});
  ASSERT_FALSE(missing.ok());
  EXPECT_EQ(missing.error().message, "--threads needs a value");
  EXPECT_FALSE(parse({"--verbose=1"}).ok());
}

TEST(Arguments, NumbersAreWholeAndInRange) {
  for (const char* bad : {"x", "", "-1", "3.5", "4 ", "0", "65", "99999999999999999999"}) {
    const auto a = parse({"--threads", bad});
    ASSERT_TRUE(a.ok());
    const auto n = a.value().number("threads", 1, 1, 64);
    ASSERT_FALSE(n.ok()) << bad;
    EXPECT_NE(n.error().message.find("--threads"), std::string::npos);
  }
  const auto a = parse({"--threads", "64"});
  EXPECT_EQ(a.value().number("threads", 1, 1, 64).value(), 64U);
  EXPECT_EQ(a.value().number("name", 7, 1, 64).value(), 7U);
}

TEST(Arguments, AssignmentsSplitAtTheFirstEqualsSign) {
  const auto a = parse({"--set", "spp=4", "--set", "file=a=b", "--set", "empty="});
  const auto values = a.value().assignments("set");
  ASSERT_TRUE(values.ok());
  EXPECT_EQ(values.value(),
            (std::map<std::string, std::string>{{"spp", "4"}, {"file", "a=b"}, {"empty", ""}}));
  EXPECT_FALSE(parse({"--set", "spp"}).value().assignments("set").ok());
  EXPECT_FALSE(parse({"--set", "=4"}).value().assignments("set").ok());
  EXPECT_TRUE(parse({}).value().assignments("set").value().empty());
}

}  // namespace
}  // namespace metrofarm::app
