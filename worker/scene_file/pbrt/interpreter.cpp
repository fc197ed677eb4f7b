#include "scene_file/pbrt/interpreter.h"

#include <utility>

#include "scene_file/names.h"
#include "scene_file/numbers.h"
#include "scene_file/pbrt/affine_inverse.h"
#include "scene_file/pbrt/zipped.h"

namespace metrofarm::scene_file::pbrt {

const Interpreter::Row Interpreter::kDirectives[] = {
    {"Accelerator", &Interpreter::accelerator, Row::Part::kOptions},
    {"ActiveTransform", &Interpreter::active_transform, Row::Part::kBoth},
    {"AreaLightSource", &Interpreter::area_light_source, Row::Part::kWorld},
    {"Attribute", &Interpreter::attribute, Row::Part::kBoth},
    {"AttributeBegin", &Interpreter::attribute_begin, Row::Part::kWorld},
    {"AttributeEnd", &Interpreter::attribute_end, Row::Part::kWorld},
    {"Camera", &Interpreter::camera, Row::Part::kOptions},
    {"ColorSpace", &Interpreter::colour_space, Row::Part::kBoth},
    {"ConcatTransform", &Interpreter::concat_transform, Row::Part::kBoth},
    {"CoordinateSystem", &Interpreter::coordinate_system, Row::Part::kBoth},
    {"CoordSysTransform", &Interpreter::coord_sys_transform, Row::Part::kBoth},
    {"Film", &Interpreter::film, Row::Part::kOptions},
    {"Identity", &Interpreter::identity, Row::Part::kBoth},
    {"Import", &Interpreter::import, Row::Part::kWorld},
    {"Include", &Interpreter::include, Row::Part::kBoth},
    {"Integrator", &Interpreter::integrator, Row::Part::kOptions},
    {"LightSource", &Interpreter::light_source, Row::Part::kWorld},
    {"LookAt", &Interpreter::look_at_directive, Row::Part::kBoth},
    {"MakeNamedMaterial", &Interpreter::make_named_material, Row::Part::kWorld},
    {"MakeNamedMedium", &Interpreter::medium, Row::Part::kBoth},
    {"Material", &Interpreter::material, Row::Part::kWorld},
    {"MediumInterface", &Interpreter::medium_interface, Row::Part::kBoth},
    {"NamedMaterial", &Interpreter::named_material, Row::Part::kWorld},
    {"ObjectBegin", &Interpreter::object_begin, Row::Part::kWorld},
    {"ObjectEnd", &Interpreter::object_end, Row::Part::kWorld},
    {"ObjectInstance", &Interpreter::object_instance, Row::Part::kWorld},
    {"Option", &Interpreter::option, Row::Part::kOptions},
    {"PixelFilter", &Interpreter::filter, Row::Part::kOptions},
    {"ReverseOrientation", &Interpreter::reverse_orientation, Row::Part::kWorld},
    {"Rotate", &Interpreter::rotate, Row::Part::kBoth},
    {"Sampler", &Interpreter::sampler, Row::Part::kOptions},
    {"Scale", &Interpreter::scale, Row::Part::kBoth},
    {"Shape", &Interpreter::shape, Row::Part::kWorld},
    {"Texture", &Interpreter::texture, Row::Part::kWorld},
    {"Transform", &Interpreter::transform, Row::Part::kBoth},
    {"TransformBegin", &Interpreter::transform_begin, Row::Part::kBoth},
    {"TransformEnd", &Interpreter::transform_end, Row::Part::kBoth},
    {"TransformTimes", &Interpreter::transform_times, Row::Part::kOptions},
    {"Translate", &Interpreter::translate, Row::Part::kBoth},
    {"WorldBegin", &Interpreter::world_begin, Row::Part::kOptions},
    {"WorldEnd", &Interpreter::world_end, Row::Part::kWorld},
};

const Interpreter::Row* Interpreter::find_directive(std::string_view name) {
  for (const Row& row : kDirectives) {
    if (row.name == name) return &row;
  }
  return nullptr;
}

void Interpreter::run(std::string_view content, const std::string& name) {
  Source source{Tokenizer(content), name};
  Source* const outer = std::exchange(source_, &source);
  while (!failed()) {
    const std::optional<Token> token = source.tokens.next();
    if (!token) break;
    source.line = token->line;
    carry_out(*token);
  }
  if (source.tokens.problem()) {
    context_.problems.fail(*source.tokens.problem(), {name, source.tokens.line()});
  }
  source_ = outer;
}

void Interpreter::carry_out(const Token& word) {
  const std::string text(word.text);
  const Row* row = word.kind == Token::Kind::kWord ? find_directive(word.text) : nullptr;
  if (!row) {
    std::vector<std::string_view> known;
    for (const Row& other : kDirectives) known.push_back(other.name);
    return fail("expected a directive such as Shape, found \"" + text + "\"" +
                suggestion(text, known));
  }
  if (row->part == Row::Part::kOptions && in_world_) {
    return fail(text + " must stand before WorldBegin");
  }
  if (row->part == Row::Part::kWorld && !in_world_) {
    return fail(text + " must stand after WorldBegin");
  }
  (this->*row->run)();
}

void Interpreter::finish(const std::string& name) {
  if (!failed() && !in_world_) {
    context_.problems.fail(
        "the file has no WorldBegin: it must stand between the camera and the "
        "scene",
        {name});
  }
  if (!failed() && !saved_.empty()) {
    context_.problems.fail(saved_.back().opened_by + " is never closed", saved_.back().where);
  }
  if (failed()) return;
  world_.finish();
  if (options_.progress) options_.progress(1, "scene loaded");
}

void Interpreter::fail(std::string message) {
  if (source_->tokens.problem()) message = *source_->tokens.problem();
  context_.problems.fail(std::move(message), here());
}

std::string Interpreter::read_string(std::string_view what) {
  const std::optional<Token>& next = source_->tokens.peek();
  if (next && next->kind == Token::Kind::kString) return unescape(source_->tokens.next()->text);
  fail("the directive needs " + std::string(what) + " in quotes");
  return "";
}

std::vector<double> Interpreter::read_numbers(size_t count) {
  std::vector<double> numbers;
  Tokenizer& tokens = source_->tokens;
  const bool bracketed = tokens.peek() && tokens.peek()->kind == Token::Kind::kOpen;
  if (bracketed) tokens.next();
  while (numbers.size() < count) {
    const std::optional<Token> token = tokens.next();
    const std::optional<double> value =
        token && token->kind == Token::Kind::kWord ? parse_double(token->text) : std::nullopt;
    if (!value) {
      fail("the directive needs " + std::to_string(count) + " numbers; found " +
           (token ? "\"" + std::string(token->text) + "\"" : "the end of the file") + " after " +
           std::to_string(numbers.size()));
      return numbers;
    }
    numbers.push_back(*value);
  }
  if (bracketed) {
    const std::optional<Token> token = tokens.next();
    if (!token || token->kind != Token::Kind::kClose) {
      fail("the directive needs " + std::to_string(count) + " numbers and then a ]");
    }
  }
  return numbers;
}

// target: of Attribute directives that apply; empty for none.
Parameters Interpreter::read_list(std::string_view target) {
  Parameters parameters(read_parameters(source_->tokens, source_->name, context_.problems), here(),
                        state_.colour_space);
  const auto defaults = state_.defaults.find(target);
  if (defaults != state_.defaults.end()) parameters.add_defaults(defaults->second);
  return parameters;
}

Entity Interpreter::read_entity(std::string_view target, std::string_view what) {
  std::string type = read_string(what);
  return {std::move(type), failed() ? Parameters{} : read_list(target)};
}

// ---- rendering options ----

void Interpreter::camera() {
  rendering_.camera = read_entity("");
  for (size_t i = 0; i < 2; ++i) {
    const std::optional<Matrix> inverse = affine_inverse(state_.transform[i]);
    if (!inverse) return fail("the camera's transform is singular: it must not flatten the world");
    rendering_.world_from_camera[i] = *inverse;
  }
  coordinate_systems_["camera"] = rendering_.world_from_camera;
}

void Interpreter::film() {
  rendering_.film = read_entity("");
}

void Interpreter::sampler() {
  rendering_.sampler = read_entity("");
}

void Interpreter::integrator() {
  rendering_.integrator = read_entity("");
}

void Interpreter::filter() {
  rendering_.filter = read_entity("");
}

void Interpreter::accelerator() {
  read_entity("");
}

// Options steer the program, not the scene.
void Interpreter::option() {
  read_list("");
}

void Interpreter::world_begin() {
  in_world_ = true;
  state_.transform = {kIdentity, kIdentity};
  state_.active = {true, true};
  coordinate_systems_["world"] = state_.transform;
  load_options(rendering_, context_);
}

// Of older files; pbrt-v4 needs it no more.
void Interpreter::world_end() {}

// ---- files ----

void Interpreter::include() {
  read_nested();
}

// Nothing that the file sets holds after it.
void Interpreter::import() {
  const GraphicsState state = state_;
  read_nested();
  state_ = state;
}

void Interpreter::read_nested() {
  const std::string name = read_string("a file name");
  if (failed()) return;
  constexpr int kDeepest = 32;
  constexpr int kMost = 100000;
  if (depth_ >= kDeepest || nested_files_ >= kMost) {
    return fail("files include each other too deeply or too often");
  }
  const FileBytes bytes = read_named_file(name, here(), context_);
  if (!bytes) return;
  const Result<FileBytes> plain = unzip_if_named_gz(name, bytes, context_.files.memory());
  if (!plain) return fail(plain.error().message);
  ++nested_files_;
  ++depth_;
  run(*plain.value(), name);
  --depth_;
}

// ---- the world ----

void Interpreter::object_begin() {
  const std::string name = read_string("a name");
  if (world_.in_object()) return fail("ObjectBegin can't stand inside of an object");
  push("ObjectBegin");
  world_.begin_object(name, here());
}

void Interpreter::object_end() {
  pop("ObjectBegin", "ObjectEnd");
  world_.end_object();
}

void Interpreter::object_instance() {
  const std::string name = read_string("the name of an object");
  world_.add_instance(name, state_, here());
}

void Interpreter::shape() {
  Entity entity = read_entity("shape");
  if (failed()) return;
  if (options_.progress) options_.progress(0, "shape \"" + entity.type + "\"");
  world_.add_shape(std::move(entity), state_);
}

void Interpreter::light_source() {
  Entity entity = read_entity("light");
  if (!failed()) world_.add_light(std::move(entity), state_);
}

void Interpreter::area_light_source() {
  Entity entity = read_entity("light");
  if (failed()) return;
  state_.area_light = std::make_shared<const AreaLight>(read_area_light(entity, context_));
}

void Interpreter::material() {
  state_.material = world_.materials().use(read_entity("material"));
}

void Interpreter::make_named_material() {
  const std::string name = read_string("a name");
  Parameters parameters = read_list("material");
  if (failed()) return;
  std::string type = parameters.text("type", "", context_.problems);
  if (type.empty()) return fail("MakeNamedMaterial needs \"string type\"");
  world_.materials().define(name, {std::move(type), std::move(parameters)});
}

void Interpreter::named_material() {
  std::string name = read_string("the name of a material");
  state_.material = world_.materials().use_named(std::move(name), here());
}

void Interpreter::texture() {
  const std::string name = read_string("a name");
  const std::string value_type = read_string("a value type, \"float\" or \"spectrum\",");
  Entity entity = read_entity("texture");
  if (!failed()) world_.textures().define(name, value_type, std::move(entity));
}

void Interpreter::medium() {
  read_string("a name");
  read_list("");
  context_.problems.unsupported(
      "participating media are not supported: remove the medium, or "
      "load leniently to render without it",
      here());
}

void Interpreter::medium_interface() {
  bool named = !read_string("the name of a medium").empty();
  const std::optional<Token>& next = source_->tokens.peek();
  if (next && next->kind == Token::Kind::kString) {
    named |= !read_string("the name of a medium").empty();
  }
  if (!named) return;
  context_.problems.unsupported(context_.problems.lenient()
                                    ? "participating media are not supported; shapes and cameras "
                                      "from here on are left without theirs"
                                    : "participating media are not supported: remove the "
                                      "MediumInterface, or load leniently to render without media",
                                here());
}

}  // namespace metrofarm::scene_file::pbrt
