// Where the files of a scene may lie.
#include <gtest/gtest.h>

#include "support.h"

namespace metrofarm::scene_file::test {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kTriangle = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";

std::string obj(const std::string& file) {
  return "<shape type=\"obj\"><string name=\"filename\" value=\"" + file + "\"/></shape>";
}

TEST(Files, AreFoundBesideTheSceneAndInSearchDirectories) {
  const Directory directory;
  directory.write("models/Mesh 1 [a].obj", kTriangle);
  EXPECT_EQ(error_of(directory, obj("models/Mesh 1 [a].obj")), "");
  EXPECT_EQ(error_of(directory, obj("models\\Mesh 1 [a].obj")), "");
  EXPECT_EQ(error_of(directory, "<path value=\"models\"/>" + obj("Mesh 1 [a].obj")), "");
  EXPECT_NE(error_of(directory, obj("Mesh 1 [a].obj")), "");
  EXPECT_EQ(error_of(directory, "<path value=\"nowhere\"/>"),
            "scene.xml:2: \"nowhere\" is not a directory");
}

TEST(Files, MissingOnesAreErrors) {
  EXPECT_EQ(error_of(obj("none.obj")).substr(0, 43),
            "scene.xml:2: file \"none.obj\" not found; loo");
  EXPECT_EQ(error_of("<shape type=\"obj\"/>"), "scene.xml:2: shape \"obj\" needs a \"filename\"");
  const Directory directory;
  fs::create_directory(directory.path() / "folder.obj");
  EXPECT_NE(error_of(directory, obj("folder.obj")), "");
  EXPECT_FALSE(load_scene(directory.path() / "none.xml", {}));
}

class Root : public testing::Test {
 protected:
  Root() {
    directory_.write("secret.obj", kTriangle);
    directory_.write("bundle/inside.obj", kTriangle);
    fs::create_symlink(directory_.path() / "secret.obj", directory_.path() / "bundle/link.obj");
    fs::create_directory_symlink(directory_.path(), directory_.path() / "bundle/up");
    fs::create_symlink("inside.obj", directory_.path() / "bundle/friend.obj");
  }

  std::string message(const std::string& content) {
    const auto scene = load_scene(directory_.write("bundle/scene.xml", scene_around(content)),
                                  {.root = directory_.path() / "bundle"});
    return scene ? "" : scene.error().message;
  }

  void expect_refused(const std::string& content) {
    EXPECT_NE(message(content).find("lies outside the scene's directory"), std::string::npos)
        << content << ": " << message(content);
  }

  Directory directory_;
};

TEST_F(Root, AllowsFilesInside) {
  EXPECT_EQ(message(obj("inside.obj")), "");
  EXPECT_EQ(message(obj("friend.obj")), "");
  EXPECT_EQ(message(obj("../bundle/inside.obj")), "");
  EXPECT_EQ(message(obj((directory_.path() / "bundle/inside.obj").string())), "");
}

// A bundle has only the folders that hold a file.
TEST_F(Root, MayLackFoldersThatAreSearched) {
  EXPECT_EQ(message("<path value=\"gone\"/>" + obj("inside.obj")), "");
  EXPECT_EQ(message("<path value=\"gone\"/>" + obj("../inside.obj")), "");
  EXPECT_EQ(message("<path value=\"inside.obj\"/>"),
            "\"" + (directory_.path() / "bundle/inside.obj").string() + "\" is not a directory");
  expect_refused("<path value=\"gone\"/>" + obj("../up/secret.obj"));
  expect_refused("<path value=\"gone/../..\"/>");
}

// What one of the folders would lead to outside may lie inside for another.
TEST_F(Root, LooksOnWhereAFolderLeadsOutside) {
  directory_.write("bundle/deep/scene.xml",
                   scene_around("<path value=\"..\"/>" + obj("../inside.obj")));
  const auto scene = load_scene(directory_.path() / "bundle/deep/scene.xml",
                                {.root = directory_.path() / "bundle"});
  EXPECT_TRUE(scene) << scene.error().to_string();
}

TEST(Files, FoldersThatAreSearchedAreTold) {
  const Directory directory;
  directory.write("common/triangle.obj", kTriangle);
  std::vector<fs::path> folders;
  LoadOptions options;
  options.folder_added = [&](const fs::path& folder) { folders.push_back(folder); };
  const std::string content = "<path value=\"../common\"/>" + obj("triangle.obj");
  EXPECT_TRUE(load_scene(directory.write("scenes/scene.xml", scene_around(content)), options));
  EXPECT_EQ(folders, std::vector{directory.path() / "scenes" / "../common"});
}

TEST_F(Root, RefusesFilesOutsideWhetherTheyExistOrNot) {
  expect_refused(obj("../secret.obj"));
  expect_refused(obj("..\\secret.obj"));
  expect_refused(obj("../nothing.obj"));
  expect_refused(obj((directory_.path() / "secret.obj").string()));
  expect_refused(obj("/etc/passwd"));
  expect_refused("<include filename=\"../secret.obj\"/>");
  expect_refused("<path value=\"..\"/>");
}

TEST_F(Root, RefusesSymbolicLinksThatLeaveIt) {
  expect_refused(obj("link.obj"));
  expect_refused(obj("up/secret.obj"));
  expect_refused("<path value=\"up\"/>");
}

TEST_F(Root, IsNotAPrefixOfNames) {
  directory_.write("bundle2/other.obj", kTriangle);
  expect_refused(obj("../bundle2/other.obj"));
}

TEST_F(Root, HoldsTheSceneFileToo) {
  const auto scene = load_scene(directory_.write("outside.xml", scene_around("")),
                                {.root = directory_.path() / "bundle"});
  ASSERT_FALSE(scene);
  EXPECT_NE(scene.error().message.find("lies outside"), std::string::npos);
  EXPECT_FALSE(load_scene(directory_.path() / "outside.xml",
                          {.root = directory_.path() / "no such directory"}));
}

}  // namespace
}  // namespace metrofarm::scene_file::test
