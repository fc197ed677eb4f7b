// Carries out the directives of a file and of those that it includes.
#pragma once

#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "scene_file/load.h"
#include "scene_file/pbrt/camera_film.h"
#include "scene_file/pbrt/graphics_state.h"
#include "scene_file/pbrt/tokenizer.h"
#include "scene_file/pbrt/world.h"

namespace metrofarm::scene_file::pbrt {

class Interpreter {
 public:
  Interpreter(Context& context, const LoadOptions& options)
      : context_(context), options_(options), world_(context) {}

  // name: as messages show it.
  void run(std::string_view content, const std::string& name);
  // Requires: run() has read the main file. Attaches materials and checks what must be there.
  void finish(const std::string& name);

 private:
  // A file that is being read.
  struct Source {
    Tokenizer tokens;
    std::string name;
    int line = 0;  // of the directive that is carried out
  };
  using Directive = void (Interpreter::*)();
  struct Row {
    std::string_view name;
    Directive run;
    enum class Part { kOptions, kWorld, kBoth } part;
  };
  static const Row kDirectives[];

  static const Row* find_directive(std::string_view name);
  void carry_out(const Token& word);

  // Arguments of directives.
  SourceLocation here() const { return {source_->name, source_->line}; }
  // Where the tokens ended in a problem of their own, that is reported instead.
  void fail(std::string message);
  bool failed() const { return context_.problems.failed(); }
  std::string read_string(std::string_view what);
  std::vector<double> read_numbers(size_t count);
  Parameters read_list(std::string_view target);
  Entity read_entity(std::string_view target, std::string_view what = "a type");

  // directives.cpp: transforms and attributes
  void apply(const Matrix& matrix);
  void set_transform(const TransformPair& pair);
  Matrix read_matrix();
  void identity();
  void translate();
  void scale();
  void rotate();
  void look_at_directive();
  void transform();
  void concat_transform();
  void coordinate_system();
  void coord_sys_transform();
  void active_transform();
  void transform_times();
  void push(std::string_view opened_by);
  void pop(std::string_view opened_by, std::string_view closed_by);
  void attribute_begin();
  void attribute_end();
  void transform_begin();
  void transform_end();
  void attribute();
  void reverse_orientation();
  void colour_space();

  // interpreter.cpp: the rest
  void world_begin();
  void world_end();
  void include();
  void import();
  void read_nested();
  void object_begin();
  void object_end();
  void object_instance();
  void camera();
  void film();
  void sampler();
  void integrator();
  void filter();
  void accelerator();
  void option();
  void shape();
  void light_source();
  void area_light_source();
  void material();
  void make_named_material();
  void named_material();
  void texture();
  void medium();
  void medium_interface();

  Context& context_;
  const LoadOptions& options_;
  World world_;
  RenderingOptions rendering_;
  GraphicsState state_;
  std::vector<SavedState> saved_;
  std::map<std::string, TransformPair> coordinate_systems_;
  Source* source_ = nullptr;
  bool in_world_ = false;
  int depth_ = 0;         // of nested files
  int nested_files_ = 0;  // in all
};

}  // namespace metrofarm::scene_file::pbrt
