// What the header for C++ specifies for wrong calls: no unbounded wait, no unchecked age, no unreported loss.
#include "equipoise.hpp"

#include <cstdlib>
#include <cstring>
#include <iostream>
#include <memory>
#include <thread>

using namespace std::chrono_literals;
using equipoise::Consumer;

#define MUST(condition)                                                                                                \
    do {                                                                                                               \
        if (!(condition)) {                                                                                            \
            std::cerr << "line " << __LINE__ << ": " #condition "; it said: " << equipoise_error() << "\n";            \
            std::exit(1);                                                                                              \
        }                                                                                                              \
    } while (false)

template <typename Thrown, typename Call> bool throws(Call call) {
    try {
        call();
    } catch (const Thrown &) {
        return true;
    }
    return false;
}

int main() {
    equipoise::Options never_stale;
    never_stale.stale_after = -1ns;
    MUST(throws<equipoise::Error>([&] { Consumer("test", "cpp", never_stale); }));
    MUST(throws<equipoise::Error>([] { Consumer("a/b", "cpp"); }));

    auto consumer = std::make_unique<Consumer>("test", "cpp");
    const equipoise::Reading reading = consumer->next(-1ns); // No process publishes.
    MUST(!reading && reading.reason() == equipoise::NoStateReason::silent);
    MUST(!consumer->next(std::chrono::nanoseconds::min()));
    MUST(throws<std::bad_variant_access>([&] { (void)(*reading).cycle(); }));
    MUST(throws<std::bad_variant_access>([&] { (void)reading->cycle(); }));
    const equipoise::Reading some{equipoise::State(equipoise_reading{})};
    MUST(some && throws<std::bad_variant_access>([&] { (void)some.reason(); }));

    MUST(std::strcmp(consumer->report_refusal(), "") == 0);
    std::thread([&] {
        MUST(std::strstr(consumer->report_refusal(), "thread") != nullptr);
        consumer.reset(); // Reported on standard error.
    }).join();
    std::cout << "all refused\n";
    return 0;
}
