// Plans of a handover: a position of the command line, or a file of `equipoise plan handover --out`.
// clients/python/handover_plans.py has the same rules; clients/handover_vectors.txt tests both.
#ifndef EQUIPOISE_HANDOVER_PLANS_HPP
#define EQUIPOISE_HANDOVER_PLANS_HPP

#include "handover.hpp"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <iostream>
#include <locale>
#include <map>
#include <sstream>
#include <string>
#include <sys/stat.h>
#include <vector>

namespace equipoise::handover {

inline constexpr double PLAN_EVERY_S = 0.2;
// Range of the slope in clients/ur/handover.script, rad.
inline constexpr double SLOPE_MAX_RAD = 1.2;
// Range of a heading, rad; the script limits it further.
inline constexpr double HEADING_MAX_RAD = 3.141592653589793;

// Validates a text as JSON (RFC 8259), and keeps its numbers and arrays of numbers.
class Json {
public:
    struct Value {
        bool is_array = false, is_numeric = false;
        std::vector<double> numbers;
    };
    using Object = std::map<std::string, Value>;

    explicit Json(const std::string &text) : text_(text) {}

    // The text is one object or array; its members or elements.
    bool object(Object &members) { return members_of(&members, 0) && is_end(); }
    bool array(Value &value) { return elements_of(value, 0) && is_end(); }

private:
    static constexpr int DEPTH_MAX = 100;

    void skip() { at_ = std::min(text_.find_first_not_of(" \t\r\n", at_), text_.size()); }
    bool is_end() { return skip(), at_ == text_.size(); }
    bool take(char expected) {
        skip();
        const bool is_there = at_ < text_.size() && text_[at_] == expected;
        at_ += is_there ? 1 : 0;
        return is_there;
    }
    bool word(const char *expected) {
        const std::size_t size = std::strlen(expected);
        const bool is_there = text_.compare(at_, size, expected) == 0;
        at_ += is_there ? size : 0;
        return is_there;
    }
    std::size_t digits() {
        const std::size_t from = at_;
        at_ = std::min(text_.find_first_not_of("0123456789", at_), text_.size());
        return at_ - from;
    }
    bool number(double &value) {
        const std::size_t from = at_;
        word("-");
        const bool has_zero = at_ < text_.size() && text_[at_] == '0';
        const std::size_t count = digits();
        if (count == 0 || (has_zero && count > 1) || (word(".") && digits() == 0)) {
            return false;
        }
        if (word("e") || word("E")) {
            if (!word("-")) {
                word("+");
            }
            if (digits() == 0) {
                return false;
            }
        }
        return parse(text_.substr(from, at_ - from), value);
    }
    // In any locale of the program the decimal separator is a point. Not `std::from_chars`: not all libraries of C++17 have it
    // for floating-point numbers.
    static bool parse(const std::string &digits, double &value) {
        std::istringstream stream(digits);
        stream.imbue(std::locale::classic());
        value = 0.0;
        stream >> value;
        if (stream.fail() && std::fabs(value) >= 1.0) {
            value = std::copysign(HUGE_VAL, value); // Too large: not finite, as in Python.
        }
        return stream.eof();
    }
    bool string(std::string &content) {
        if (!take('"')) {
            return false;
        }
        const std::size_t from = at_;
        for (; at_ < text_.size() && text_[at_] != '"'; at_++) {
            if (static_cast<unsigned char>(text_[at_]) < 0x20) {
                return false;
            }
            if (text_[at_] == '\\') {
                at_++;
                if (at_ >= text_.size() || std::strchr("\"\\/bfnrtu", text_[at_]) == nullptr) {
                    return false;
                }
                if (text_[at_] == 'u') {
                    const std::size_t end = text_.find_first_not_of("0123456789abcdefABCDEF", at_ + 1);
                    if (std::min(end, text_.size()) < at_ + 5) {
                        return false;
                    }
                }
            }
        }
        content = text_.substr(from, at_ - from);
        return take('"');
    }
    bool members_of(Object *members, int depth) {
        if (depth > DEPTH_MAX || !take('{')) {
            return false;
        }
        if (take('}')) {
            return true;
        }
        do {
            std::string key;
            Value value;
            skip();
            if (!string(key) || !take(':') || !value_of(value, depth + 1)) {
                return false;
            }
            if (members != nullptr) {
                (*members)[key] = value;
            }
        } while (take(','));
        return take('}');
    }
    bool elements_of(Value &value, int depth) {
        if (depth > DEPTH_MAX || !take('[')) {
            return false;
        }
        value.is_array = value.is_numeric = true;
        if (take(']')) {
            return true;
        }
        do {
            Value element;
            if (!value_of(element, depth + 1)) {
                return false;
            }
            value.is_numeric = value.is_numeric && element.is_numeric && !element.is_array;
            value.numbers.insert(value.numbers.end(), element.numbers.begin(), element.numbers.end());
        } while (take(','));
        return take(']');
    }
    bool value_of(Value &value, int depth) {
        skip();
        const char first = at_ < text_.size() ? text_[at_] : '\0';
        if (first == '{') {
            return members_of(nullptr, depth);
        }
        if (first == '[') {
            return elements_of(value, depth);
        }
        if (first == '"') {
            std::string content;
            return string(content);
        }
        if (word("true") || word("false") || word("null")) {
            return true;
        }
        value.is_numeric = true;
        value.numbers.resize(1);
        return number(value.numbers[0]);
    }

    const std::string &text_;
    std::size_t at_ = 0;
};

inline bool is_finite(const Json::Value &value, bool is_array, std::size_t count) {
    bool all = value.is_numeric && value.is_array == is_array && value.numbers.size() == count;
    for (const double number : value.numbers) {
        all = all && std::isfinite(number);
    }
    return all;
}

// Position of `X,Y,Z`, m.
inline std::optional<Position> target_of(const std::string &words) {
    const std::string text = "[" + words + "]";
    Json::Value at;
    if (!Json(text).array(at) || !is_finite(at, true, 3)) {
        return std::nullopt;
    }
    return Position{at.numbers[0], at.numbers[1], at.numbers[2]};
}

// Plan of a file's text.
inline std::optional<Plan> plan_of(const std::string &text, std::uint64_t generation) {
    Json::Object members;
    if (!Json(text).object(members)) {
        return std::nullopt;
    }
    const Json::Value &at = members["position_m"], &ratio = members["worst_limit_ratio"],
                      &sigma = members["worst_limit_ratio_sigma"];
    if (!is_finite(at, true, 3) || !is_finite(ratio, false, 1) || !is_finite(sigma, false, 1)) {
        return std::nullopt;
    }
    double slope_rad = 0.0; // Absent in plans of earlier versions.
    if (const auto slope = members.find("slope_rad"); slope != members.end()) {
        if (!is_finite(slope->second, false, 1) || std::fabs(slope->second.numbers[0]) > SLOPE_MAX_RAD) {
            return std::nullopt;
        }
        slope_rad = slope->second.numbers[0];
    }
    double heading_rad = 0.0; // Level handles do without: a plan of an earlier version.
    if (const auto heading = members.find("feet_heading_rad"); heading != members.end()) {
        if (!is_finite(heading->second, false, 1) || std::fabs(heading->second.numbers[0]) > HEADING_MAX_RAD) {
            return std::nullopt;
        }
        heading_rad = heading->second.numbers[0];
    } else if (slope_rad != 0.0) {
        return std::nullopt;
    }
    const Position at_m{at.numbers[0], at.numbers[1], at.numbers[2]};
    return Plan{generation, at_m, ratio.numbers[0], sigma.numbers[0], slope_rad, heading_rad};
}

// The newest plan: a position of the command line, or a file, read again when it changes.
class Plans {
public:
    bool set_target(const std::string &words) {
        const auto at = target_of(words);
        if (at) {
            newest = Plan{1, *at, 0.0, 0.0};
        }
        return at.has_value();
    }
    void set_path(const std::string &path) { path_ = path; }

    // A file that cannot be read leaves the plan as it is, as does one whose text is that of the last plan.
    void poll(double now_s) {
        if (path_.empty() || now_s < due_s_) {
            return;
        }
        due_s_ = now_s + PLAN_EVERY_S;
        struct stat found {};
        if (stat(path_.c_str(), &found) != 0) {
            return report(std::string("cannot be read: ") + std::strerror(errno));
        }
        if (found.st_mtim.tv_sec == changed_.tv_sec && found.st_mtim.tv_nsec == changed_.tv_nsec) {
            return;
        }
        std::ifstream file(path_, std::ios::binary);
        std::stringstream content;
        content << file.rdbuf();
        const auto plan = plan_of(content.str(), newest ? newest->generation + 1 : 1);
        if (!plan) {
            // Read again at the next poll: it may be incomplete.
            return report("no valid position_m, worst_limit_ratio, worst_limit_ratio_sigma, slope_rad and feet_heading_rad");
        }
        changed_ = found.st_mtim;
        reported_.clear();
        if (content.str() != text_) {
            text_ = content.str();
            newest = plan;
        }
    }

    std::optional<Plan> newest;

private:
    // Reports an unusable file once.
    void report(const std::string &why) {
        if (why != reported_) {
            std::cerr << path_ << ": " << why << "; `equipoise plan handover --out " << path_ << "` writes it" << std::endl;
        }
        reported_ = why;
    }

    std::string path_, text_, reported_;
    double due_s_ = 0.0;
    timespec changed_{};
};

} // namespace equipoise::handover

#endif
