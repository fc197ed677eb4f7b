// From tokens to parameters.
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>

#include "scene_file/names.h"
#include "scene_file/numbers.h"
#include "scene_file/pbrt/parameters.h"

namespace metrofarm::scene_file::pbrt {
namespace {

struct TypeRow {
  std::string_view name;
  ParameterType type;
  int group;  // numbers come in multiples of this; 0: the values are strings
};

constexpr auto kTypes = std::to_array<TypeRow>({
    {"bool", ParameterType::kBool, 1},
    {"integer", ParameterType::kInteger, 1},
    {"float", ParameterType::kFloat, 1},
    {"point2", ParameterType::kPoint2, 2},
    {"vector2", ParameterType::kVector2, 2},
    {"point3", ParameterType::kPoint3, 3},
    {"point", ParameterType::kPoint3, 3},
    {"vector3", ParameterType::kVector3, 3},
    {"vector", ParameterType::kVector3, 3},
    {"normal", ParameterType::kNormal, 3},
    {"normal3", ParameterType::kNormal, 3},
    {"rgb", ParameterType::kRgb, 3},
    {"spectrum", ParameterType::kSpectrum, 1},
    {"blackbody", ParameterType::kBlackbody, 1},
    {"string", ParameterType::kString, 0},
    {"texture", ParameterType::kTexture, 0},
});

const TypeRow* find_type(std::string_view name) {
  for (const TypeRow& row : kTypes) {
    if (row.name == name) return &row;
  }
  return nullptr;
}

class ListReader {
 public:
  ListReader(Tokenizer& tokens, const std::string& file, Problems& problems)
      : tokens_(tokens), file_(file), problems_(problems) {}

  std::vector<Parameter> read() {
    std::vector<Parameter> list;
    while (!problems_.failed() && tokens_.peek() && tokens_.peek()->kind == Token::Kind::kString) {
      Parameter parameter = read_one();
      for (const Parameter& other : list) {
        if (other.name == parameter.name) {
          fail("parameter \"" + parameter.name + "\" is given twice", parameter.where.line);
        }
      }
      list.push_back(std::move(parameter));
    }
    return list;
  }

 private:
  void fail(std::string message, int line) {
    if (tokens_.problem()) return problems_.fail(*tokens_.problem(), {file_, tokens_.line()});
    problems_.fail(std::move(message), {file_, line});
  }

  Parameter read_one() {
    const Token declaration = *tokens_.next();
    Parameter parameter;
    parameter.where = {file_, declaration.line};
    const std::vector<std::string_view> words = split_list(declaration.text);
    row_ = words.size() == 2 ? find_type(words[0]) : nullptr;
    if (!row_) {
      report_declaration(declaration, words);
      return parameter;
    }
    parameter.type = row_->type;
    parameter.name = words[1];
    read_values(parameter);
    check_count(parameter);
    return parameter;
  }

  void report_declaration(const Token& declaration, const std::vector<std::string_view>& words) {
    const std::string text(declaration.text);
    if (words.size() != 2) {
      return fail("a parameter is declared as \"type name\", such as \"float radius\"; found \"" +
                      text + "\"",
                  declaration.line);
    }
    std::vector<std::string_view> known;
    for (const TypeRow& row : kTypes) known.push_back(row.name);
    fail("unknown parameter type \"" + std::string(words[0]) + "\" in \"" + text + "\"" +
             suggestion(words[0], known),
         declaration.line);
  }

  void read_values(Parameter& parameter) {
    std::optional<Token> token = tokens_.next();
    if (token && token->kind != Token::Kind::kOpen) return add(parameter, *token);
    while (token && !problems_.failed()) {
      token = tokens_.next();
      if (token && token->kind == Token::Kind::kClose) return;
      if (token) add(parameter, *token);
    }
    if (!token) {
      fail("the values of parameter \"" + parameter.name + "\" end early: a ] is missing",
           parameter.where.line);
    }
  }

  void add(Parameter& parameter, const Token& token) {
    if (token.kind == Token::Kind::kOpen || token.kind == Token::Kind::kClose) {
      return fail("parameter \"" + parameter.name + "\" needs a value; found \"" +
                      std::string(token.text) + "\"",
                  token.line);
    }
    const bool quoted = token.kind == Token::Kind::kString;
    if (parameter.type == ParameterType::kBool) return add_bool(parameter, token);
    if (quoted && (row_->group == 0 || parameter.type == ParameterType::kSpectrum)) {
      parameter.strings.push_back(unescape(token.text));
      return;
    }
    const std::optional<double> value =
        quoted || row_->group == 0 ? std::nullopt : parse_double(token.text);
    const bool fits = value && (parameter.type != ParameterType::kInteger || is_integer(*value));
    if (fits) return parameter.numbers.push_back(*value);
    fail("a value of \"" + std::string(row_->name) + " " + parameter.name + "\" must be " +
             wanted_value() + "; found \"" + std::string(token.text) + "\"",
         token.line);
  }

  static bool is_integer(double value) {
    return value == std::trunc(value) && std::abs(value) <= std::numeric_limits<int32_t>::max();
  }

  std::string wanted_value() const {
    if (row_->group == 0) return "a string in quotes";
    return row_->type == ParameterType::kInteger ? "a whole number of 32 bits" : "a finite number";
  }

  void add_bool(Parameter& parameter, const Token& token) {
    if (token.text == "true" || token.text == "false") {
      return parameter.numbers.push_back(token.text == "true" ? 1 : 0);
    }
    fail("a value of \"bool " + parameter.name + "\" must be true or false; found \"" +
             std::string(token.text) + "\"",
         token.line);
  }

  void check_count(const Parameter& parameter) {
    if (row_->group < 2 || parameter.numbers.size() % static_cast<size_t>(row_->group) == 0) {
      return;
    }
    fail("the values of \"" + std::string(row_->name) + " " + parameter.name +
             "\" must come in groups of " + std::to_string(row_->group) + "; found " +
             std::to_string(parameter.numbers.size()) + " numbers",
         parameter.where.line);
  }

  Tokenizer& tokens_;
  const std::string& file_;
  Problems& problems_;
  const TypeRow* row_ = nullptr;
};

}  // namespace

std::vector<Parameter> read_parameters(Tokenizer& tokens, const std::string& file,
                                       Problems& problems) {
  return ListReader(tokens, file, problems).read();
}

}  // namespace metrofarm::scene_file::pbrt
