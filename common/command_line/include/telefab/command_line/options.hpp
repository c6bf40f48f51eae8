// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <concepts>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <variant>
#include <vector>

namespace CLI {
class App;
class Option;
}  // namespace CLI

namespace telefab {

/// Where the value of an option goes. What it points to must outlive the parsing.
using OptionValue = std::variant<std::string*, double*, int*, std::uint16_t*, std::uint32_t*, std::uint64_t*,
                                 std::optional<std::string>*, std::optional<double>*, std::optional<std::uint32_t>*,
                                 std::vector<std::string>*, std::vector<double>*>;

/// An option that was declared. A handle: copies mean the same one, as long as the program's options live.
class Option {
 public:
  const Option& required(bool is = true) const;
  /// Help shows what the value is now, and what it is where the option is left out.
  const Option& shows_default() const;
  /// The same with a text of its own, where the value itself stays unset.
  const Option& shows_default(const std::string& text) const;
  /// Only numbers of that range, ends included. Whole ends: whole numbers only.
  template <std::integral Number>
  const Option& within(Number least, Number most) const {
    return within_whole(static_cast<std::int64_t>(least), static_cast<std::int64_t>(most));
  }
  const Option& within(double least, double most) const;
  const Option& above_zero() const;
  /// Only numbers for which this holds; `rule` says it in words: "above 0".
  const Option& such_that(const std::string& rule, std::function<bool(double)> holds) const;
  /// Only texts that `read` takes: it gives a Result, and what it says is wrong is an error of the command line.
  template <class Read>
  const Option& read_by(Read read) const {
    return refused_by([read = std::move(read)](const std::string& given) {
      const auto value = read(given);
      return value ? std::string{} : value.error().what;
    });
  }
  /// Only texts of which `problem` finds nothing to say.
  const Option& refused_by(std::function<std::string(const std::string&)> problem) const;
  const Option& one_of(std::vector<std::string> words) const;
  /// Help shows `what` for the value: "MACHINE". Where the program has a verb that lists such things, `machines`,
  /// completion asks it for their names.
  const Option& names(const std::string& what) const;
  /// A variable of the environment that stands in for the option.
  const Option& environment(const std::string& variable) const;
  /// Not both of them.
  const Option& excludes(const Option& other) const;
  /// Several values in one word.
  const Option& separated_by(char mark) const;

 private:
  friend class VerbOptions;
  explicit Option(CLI::Option* option) : option_{option} {}
  const Option& within_whole(std::int64_t least, std::int64_t most) const;
  CLI::Option* option_;
};

/// The options of one verb, in the order in which help shows them.
class VerbOptions {
 public:
  /// What a verb writes, for whoever looks at it before the verb runs.
  struct Outputs {
    struct Place {
      std::string option;                               ///< its name
      std::function<std::vector<std::string>()> paths;  ///< what it is set to, once the line was read
    };
    std::vector<Place> places;
    bool is_forced = false;
  };
  VerbOptions(CLI::App& app, Outputs& outputs) : app_{app}, outputs_{outputs} {}
  /// `names`: "--out", or "FILE" for one by its place.
  Option add(const std::string& names, OptionValue into, const std::string& help);
  /// A file or folder that the verb makes: what lies there already is replaced only where --force says so, and refused
  /// before the verb runs. The first of them declares --force.
  /// `endings`: what the verb puts behind the value to make its names, where it writes several files.
  Option add_output(const std::string& names, std::string& into, const std::string& help,
                    std::vector<std::string> endings = {""});
  Option add_output(const std::string& names, std::optional<std::string>& into, const std::string& help);
  template <class Value>
  requires std::constructible_from<OptionValue, Value*> Option add(const std::string& names, Value& into,
                                                                   const std::string& help) {
    return add(names, OptionValue{&into}, help);
  }
  Option flag(const std::string& name, bool& into, const std::string& help);
  /// What is said below the options.
  void footer(const std::string& text);

 private:
  Option add_place(const std::string& names, OptionValue into, const std::string& help,
                   std::function<std::vector<std::string>()> paths);
  CLI::App& app_;
  Outputs& outputs_;
};

}  // namespace telefab
