// pbrt files as tokens: words, quoted strings and brackets; '#' starts a comment.
#pragma once

#include <optional>
#include <string>
#include <string_view>

namespace metrofarm::scene_file::pbrt {

struct Token {
  enum class Kind { kWord, kString, kOpen, kClose };
  Kind kind = Kind::kWord;
  std::string_view text;  // of a string: what stands between the quotes, escapes not resolved
  int line = 0;
};

// Tokens point into the content, which must outlive them.
class Tokenizer {
 public:
  explicit Tokenizer(std::string_view content) : content_(content) {}

  // The next token; nothing at the end of the file and after a problem.
  std::optional<Token> next();
  // The token that next() will return.
  const std::optional<Token>& peek();

  // A string that is not closed, if that ended the tokens.
  const std::optional<std::string>& problem() const { return problem_; }
  int line() const { return line_; }

 private:
  std::optional<Token> scan();
  std::optional<Token> scan_string();
  void skip_space();

  std::string_view content_;
  size_t at_ = 0;
  int line_ = 1;
  std::optional<std::optional<Token>> peeked_;
  std::optional<std::string> problem_;
};

// Resolves \" \\ \' \n \t \r \b \f.
std::string unescape(std::string_view text);

}  // namespace metrofarm::scene_file::pbrt
