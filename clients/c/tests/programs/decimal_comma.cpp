// Numbers of a target and of a plan in a program with a decimal comma: decimal_comma [LOCALE OF C].
#include "handover_plans.hpp"

#include <clocale>
#include <cstdio>
#include <locale>

using namespace equipoise::handover;

namespace {

struct Comma : std::numpunct<char> {
    char do_decimal_point() const override { return ','; }
    char do_thousands_sep() const override { return '.'; }
    std::string do_grouping() const override { return "\3"; }
};

bool is_read() {
    const auto at_m = target_of("0.5,-1.25e-1,1234.5");
    const auto plan = plan_of(
        R"({"position_m": [0.5, 0.1, 1.1], "worst_limit_ratio": 0.4, "worst_limit_ratio_sigma": 0.05})", 1);
    return at_m && at_m->x == 0.5 && at_m->y == -0.125 && at_m->z == 1234.5 && plan && plan->at_m.z == 1.1 &&
           plan->limit_ratio == 0.4 && plan->sigma == 0.05;
}

} // namespace

int main(int argc, char **argv) {
    std::locale::global(std::locale(std::locale::classic(), new Comma));
    if (argc > 1 && (std::setlocale(LC_ALL, argv[1]) == nullptr || *std::localeconv()->decimal_point != ',')) {
        std::puts("no such locale");
        return 2;
    }
    std::puts(is_read() ? "read" : "wrong");
    return 0;
}
