// Connects to IPV4 PORT by clients/cpp/rtde.hpp and sends `hold` each 8 ms until it is killed, for .ci/cobot.py.
#include "rtde.hpp"

#include <chrono>
#include <cstdlib>
#include <thread>

int main(int argc, char **argv) {
    using namespace equipoise::handover;
    Cobot cobot(argc > 1 ? argv[1] : "", static_cast<std::uint16_t>(argc > 2 ? std::atoi(argv[2]) : 0));
    for (;;) {
        const auto since = std::chrono::steady_clock::now().time_since_epoch();
        const double now_s = std::chrono::duration<double>(since).count();
        cobot.poll(now_s);
        cobot.send(now_s, {Command::hold, {0.0, 0.0, 0.0}});
        std::this_thread::sleep_for(std::chrono::milliseconds(8));
    }
}
