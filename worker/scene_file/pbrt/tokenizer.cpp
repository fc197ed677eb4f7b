#include "scene_file/pbrt/tokenizer.h"

#include <array>
#include <utility>

namespace metrofarm::scene_file::pbrt {
namespace {

bool is_space(char c) {
  return c == ' ' || c == '\t' || c == '\n' || c == '\r' || c == '\v' || c == '\f';
}

bool ends_word(char c) {
  return is_space(c) || c == '"' || c == '[' || c == ']' || c == '#';
}

}  // namespace

std::optional<Token> Tokenizer::next() {
  if (!peeked_) return scan();
  std::optional<Token> token = *peeked_;
  peeked_.reset();
  return token;
}

const std::optional<Token>& Tokenizer::peek() {
  if (!peeked_) peeked_ = scan();
  return *peeked_;
}

void Tokenizer::skip_space() {
  while (at_ < content_.size()) {
    if (content_[at_] == '#') {
      at_ = std::min(content_.find('\n', at_), content_.size());
    } else if (is_space(content_[at_])) {
      if (content_[at_] == '\n') ++line_;
      ++at_;
    } else {
      return;
    }
  }
}

std::optional<Token> Tokenizer::scan() {
  if (problem_) return std::nullopt;
  skip_space();
  if (at_ == content_.size()) return std::nullopt;
  const char c = content_[at_];
  if (c == '"') return scan_string();
  const size_t begin = at_++;
  if (c == '[') return Token{Token::Kind::kOpen, content_.substr(begin, 1), line_};
  if (c == ']') return Token{Token::Kind::kClose, content_.substr(begin, 1), line_};
  while (at_ < content_.size() && !ends_word(content_[at_])) ++at_;
  return Token{Token::Kind::kWord, content_.substr(begin, at_ - begin), line_};
}

std::optional<Token> Tokenizer::scan_string() {
  const size_t begin = ++at_;
  for (; at_ < content_.size() && content_[at_] != '\n'; ++at_) {
    if (content_[at_] == '"') {
      return Token{Token::Kind::kString, content_.substr(begin, at_++ - begin), line_};
    }
    if (content_[at_] == '\\' && at_ + 1 < content_.size() && content_[at_ + 1] != '\n') ++at_;
  }
  problem_ = "a string must be closed with \" on the line on which it begins";
  return std::nullopt;
}

std::string unescape(std::string_view text) {
  constexpr std::array<std::pair<char, char>, 5> kEscapes = {
      {{'n', '\n'}, {'t', '\t'}, {'r', '\r'}, {'b', '\b'}, {'f', '\f'}}};
  std::string plain;
  plain.reserve(text.size());
  for (size_t i = 0; i < text.size(); ++i) {
    char c = text[i];
    if (c == '\\' && i + 1 < text.size()) {
      c = text[++i];
      for (const auto& [name, meaning] : kEscapes) {
        if (c == name) {
          c = meaning;
          break;
        }
      }
    }
    plain += c;
  }
  return plain;
}

}  // namespace metrofarm::scene_file::pbrt
