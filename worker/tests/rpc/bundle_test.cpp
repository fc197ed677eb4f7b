#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <sstream>

#include "rpc/bundle_writer.h"
#include "rpc/sha256.h"

namespace metrofarm::rpc {
namespace {

namespace fs = std::filesystem;
using metrofarm::scene::v1::BundleManifest;

TEST(Sha256, GivesTheKnownAnswers) {
  EXPECT_EQ(sha256_hex(""), "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
  EXPECT_EQ(sha256_hex("abc"), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
  Sha256 hash;
  hash.update("a");
  hash.update("bc");
  EXPECT_EQ(hash.finish(), sha256_hex("abc"));
}

TEST(BundlePath, PlainRelativePathsAreSafe) {
  for (const char* path :
       {"scene.xml", "a/b/c.ply", "..a", "a..b/c", "a b", ".hidden", "\xc3\xa9.xml"})
    EXPECT_TRUE(is_safe_bundle_path(path)) << path;
  EXPECT_TRUE(is_safe_bundle_path(std::string(1024, 'a')));
}

TEST(BundlePath, WhatCouldLeaveTheBundleIsNot) {
  for (const char* path : {"", "/etc/passwd", "..", "../x", "a/../b", "a/..", ".", "./a", "a/./b",
                           "a//b", "a/", "a\\b", "C:\\x", "/"})
    EXPECT_FALSE(is_safe_bundle_path(path)) << path;
  EXPECT_FALSE(is_safe_bundle_path(std::string("a\0b", 3)));
  EXPECT_FALSE(is_safe_bundle_path(std::string(1025, 'a')));
}

struct File {
  std::string path, content;
};

class BundleWriterTest : public testing::Test {
 protected:
  BundleWriterTest() {
    directory_ =
        fs::temp_directory_path() / ("metrofarm-bundle-test-" + std::to_string(getpid()) + "-" +
                                     testing::UnitTest::GetInstance()->current_test_info()->name());
    fs::remove_all(directory_);
    fs::create_directories(directory_);
  }
  ~BundleWriterTest() override {
    std::error_code ignored;
    fs::remove_all(directory_, ignored);
  }

  static BundleManifest manifest_of(const std::vector<File>& files) {
    BundleManifest manifest;
    for (const File& file : files) {
      auto* entry = manifest.add_files();
      entry->set_path(file.path);
      entry->set_size(file.content.size());
      entry->set_sha256(sha256_hex(file.content));
    }
    return manifest;
  }
  static std::string digest_of(const BundleManifest& manifest) {
    std::string text;
    for (const auto& f : manifest.files())
      text += f.sha256() + " " + std::to_string(f.size()) + " " + f.path() + "\n";
    return sha256_hex(text);
  }
  std::string read(const std::string& path) const {
    std::ifstream in(target() / path, std::ios::binary);
    std::ostringstream out;
    out << in.rdbuf();
    return out.str();
  }
  fs::path target() const { return directory_ / "bundle"; }
  bool nothing_left() const { return fs::is_empty(directory_); }

  const std::vector<File> files_ = {{"empty.txt", ""},
                                    {"mesh/a.ply", std::string(1000, 'x')},
                                    {"scene.xml", "<scene/>"},
                                    {"z", ""}};
  fs::path directory_;
};

TEST_F(BundleWriterTest, PutsAWholeBundleInPlaceHoweverItIsCut) {
  const BundleManifest manifest = manifest_of(files_);
  const std::string all = files_[1].content + files_[2].content;
  for (size_t piece : {size_t{1}, size_t{7}, all.size()}) {
    fs::remove_all(target());
    BundleWriter writer(target());
    ASSERT_EQ(writer.begin(manifest, digest_of(manifest)), "");
    EXPECT_FALSE(fs::exists(target())) << "not before it is whole";
    for (size_t at = 0; at < all.size(); at += piece)
      ASSERT_EQ(writer.append(std::string_view(all).substr(at, piece)), "");
    ASSERT_EQ(writer.finish(), "");
    for (const File& file : files_) EXPECT_EQ(read(file.path), file.content);
  }
}

TEST_F(BundleWriterTest, AManifestOfAnotherDigestIsRefused) {
  BundleWriter writer(target());
  EXPECT_NE(writer.begin(manifest_of(files_), std::string(64, '0')), "");
}

TEST_F(BundleWriterTest, UnsafePathsAreRefusedBeforeAnythingIsWritten) {
  const BundleManifest manifest = manifest_of({{"a", "x"}, {"../escape", "y"}});
  {
    BundleWriter writer(target());
    EXPECT_NE(writer.begin(manifest, digest_of(manifest)).find("../escape"), std::string::npos);
  }
  EXPECT_TRUE(nothing_left());
}

TEST_F(BundleWriterTest, TamperedContentIsRefusedAndRemoved) {
  const BundleManifest manifest = manifest_of(files_);
  {
    BundleWriter writer(target());
    ASSERT_EQ(writer.begin(manifest, digest_of(manifest)), "");
    std::string content = files_[1].content;
    content[500] = 'y';
    EXPECT_NE(writer.append(content).find("mesh/a.ply"), std::string::npos);
  }
  EXPECT_TRUE(nothing_left());
}

TEST_F(BundleWriterTest, ABundleThatEndsEarlyIsRefused) {
  const BundleManifest manifest = manifest_of(files_);
  for (size_t length : {size_t{0}, size_t{10}, size_t{1000}, size_t{1003}}) {
    {
      BundleWriter writer(target());
      ASSERT_EQ(writer.begin(manifest, digest_of(manifest)), "");
      const std::string all = files_[1].content + files_[2].content;
      ASSERT_EQ(writer.append(std::string_view(all).substr(0, length)), "");
      EXPECT_NE(writer.finish(), "") << length;
    }
    EXPECT_TRUE(nothing_left());
  }
}

TEST_F(BundleWriterTest, MoreThanTheManifestNamesIsRefused) {
  const BundleManifest manifest = manifest_of(files_);
  BundleWriter writer(target());
  ASSERT_EQ(writer.begin(manifest, digest_of(manifest)), "");
  EXPECT_NE(writer.append(files_[1].content + files_[2].content + "!"), "");
}

TEST_F(BundleWriterTest, AnotherWorkersBundleStays) {
  const BundleManifest manifest = manifest_of(files_);
  BundleWriter writer(target());
  ASSERT_EQ(writer.begin(manifest, digest_of(manifest)), "");
  ASSERT_EQ(writer.append(files_[1].content + files_[2].content), "");
  fs::create_directories(target());
  std::ofstream(target() / "scene.xml") << "<scene/>";
  EXPECT_EQ(writer.finish(), "");
  EXPECT_EQ(read("scene.xml"), "<scene/>");
}

}  // namespace
}  // namespace metrofarm::rpc
