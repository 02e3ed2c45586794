// RTDE client (Universal Robots, protocol version 2) for the registers of clients/ur/handover.script; POSIX sockets.
// Reconnects by itself. Only `poll` waits, and only while it connects: up to 0.6 s, less than the gap between two states
// that discards the target (STATE_GAP_MAX_S).
#ifndef EQUIPOISE_RTDE_HPP
#define EQUIPOISE_RTDE_HPP

#include "handover.hpp"

#include <algorithm>
#include <arpa/inet.h>
#include <array>
#include <cerrno>
#include <chrono>
#include <cstdint>
#include <cstring>
#include <fcntl.h>
#include <iostream>
#include <map>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <string>
#include <sys/socket.h>
#include <unistd.h>
#include <vector>

namespace equipoise::handover {

class Cobot {
public:
    Cobot(const std::string &host, std::uint16_t port) {
        address_.sin_family = AF_INET;
        address_.sin_port = htons(port);
        is_valid_ = inet_pton(AF_INET, host.c_str(), &address_.sin_addr) == 1;
    }
    ~Cobot() { close_socket(); }
    Cobot(const Cobot &) = delete;
    Cobot &operator=(const Cobot &) = delete;

    // The address is an IPv4 address.
    bool is_valid() const { return is_valid_; }
    int activity() const { return activity_; }
    // The cobot does not follow the commands.
    bool is_held() const { return activity_ == OUTSIDE || activity_ == NO_HEARTBEAT; }
    // Times from sending a command to its sequence in the cobot's output, s.
    const std::vector<double> &answer_s() const { return answer_s_; }

    // Position of the TCP in the station's world; nullopt while the cobot is not ready.
    std::optional<Position> part_m(double now_s) const {
        const bool is_current = socket_ >= 0 && now_s - at_s_ < SILENT_S;
        return is_current && is_ready_ ? std::optional<Position>(position_) : std::nullopt;
    }

    // Connects if necessary, and takes what the cobot has sent.
    void poll(double now_s) {
        if (socket_ < 0) {
            if (now_s < try_at_s_) {
                return;
            }
            try_at_s_ = now_s + CONNECT_EVERY_S;
            if (const char *why = connect()) {
                lose(why);
            }
            return;
        }
        if (!receive(0)) {
            lose("it closed the connection");
            return;
        }
        char kind = 0;
        std::string payload;
        while (next(kind, payload)) {
            if (kind == 'U' && payload.size() == OUTPUT_BYTES) {
                take(now_s, payload);
            }
        }
        if (is_malformed()) {
            lose("it sent a package shorter than its header");
        } else if (now_s - at_s_ > LEAVE_AFTER_S) {
            lose("it sends no more packages");
        }
    }

    // Writes the registers, unless the cobot is silent: queued commands would arrive late.
    void send(double now_s, const Output &output) {
        if (socket_ < 0 || now_s - at_s_ > SILENT_S) {
            return;
        }
        sequence_ = sequence_ == INT32_MAX ? 1 : sequence_ + 1;
        std::string payload(1, static_cast<char>(recipe_));
        append(payload, static_cast<std::uint32_t>(output.command), 4);
        append(payload, static_cast<std::uint32_t>(sequence_), 4);
        for (const double value :
             {output.target_m.x, output.target_m.y, output.target_m.z, output.slope_rad, output.heading_rad}) {
            std::uint64_t bits = 0;
            std::memcpy(&bits, &value, sizeof bits);
            append(payload, bits, 8);
        }
        // A short write would break the stream: the cobot reads no more, and must hold.
        if (!write('U', payload)) {
            lose("it takes no more packages");
            return;
        }
        if (sent_at_s_.size() > 1000) {
            sent_at_s_.clear();
        }
        sent_at_s_[sequence_] = now_s;
    }

private:
    // Limits as in gateways/src/rtde/link.rs, except the one of the connection and its handshake.
    static constexpr double SILENT_S = 0.1, LEAVE_AFTER_S = 0.3, CONNECT_EVERY_S = 1.0, START_WITHIN_S = 0.6;
    static constexpr int NORMAL = 1, PLAYING = 2, OUTSIDE = 3, NO_HEARTBEAT = 4, PROTECTIVE = 5;
    static constexpr std::size_t OUTPUT_BYTES = 1 + 4 + 4 + 3 * 8 + 4 + 4, SAMPLES_MAX = 1 << 16,
                                 HEADER_BYTES = 3, READ_BYTES_MAX = 1 << 16;

    static double clock_s() {
        return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
    }

    static void append(std::string &bytes, std::uint64_t value, int size) {
        for (int shift = 8 * (size - 1); shift >= 0; shift -= 8) {
            bytes.push_back(static_cast<char>(value >> shift & 0xff));
        }
    }
    static std::uint64_t number(const std::string &bytes, std::size_t at, std::size_t size) {
        std::uint64_t value = 0;
        for (std::size_t index = at; index < at + size; index++) {
            value = value << 8 | static_cast<unsigned char>(bytes[index]);
        }
        return value;
    }
    static double real(const std::string &bytes, std::size_t at) {
        const std::uint64_t bits = number(bytes, at, 8);
        double value = 0.0;
        std::memcpy(&value, &bits, sizeof value);
        return value;
    }

    const char *connect() {
        end_s_ = clock_s() + START_WITHIN_S;
        socket_ = socket(AF_INET, SOCK_STREAM, 0);
        if (socket_ < 0) {
            return "no socket";
        }
        fcntl(socket_, F_SETFL, O_NONBLOCK);
        const int yes = 1;
        setsockopt(socket_, IPPROTO_TCP, TCP_NODELAY, &yes, sizeof yes);
        // Commands that are undelivered when the connection closes must never arrive: reset it.
        const linger reset{1, 0};
        setsockopt(socket_, SOL_SOCKET, SO_LINGER, &reset, sizeof reset);
        if (::connect(socket_, reinterpret_cast<const sockaddr *>(&address_), sizeof address_) != 0 && errno != EINPROGRESS) {
            return std::strerror(errno);
        }
        pollfd ready{socket_, POLLOUT, 0};
        int error = 0;
        socklen_t size = sizeof error;
        if (::poll(&ready, 1, left_ms()) != 1 || getsockopt(socket_, SOL_SOCKET, SO_ERROR, &error, &size) != 0 ||
            error != 0) {
            return error != 0 ? std::strerror(error) : "it does not answer";
        }
        received_.clear();
        std::string rate, answer;
        std::uint64_t bits = 0;
        std::memcpy(&bits, &OUTPUT_HZ, sizeof bits);
        append(rate, bits, 8);
        if (!ask('V', std::string("\0\2", 2), answer) || answer != "\1") {
            return "it does not support version 2 of RTDE";
        }
        if (!ask('O', rate + registers("output") + ",safety_mode,runtime_state", answer) || answer.empty() || answer[0] == 0) {
            return "it does not provide the outputs";
        }
        const std::string inputs = registers("input") + ",input_double_register_39,input_double_register_40";
        if (!ask('I', inputs, answer) || answer.empty() || answer[0] == 0) {
            return "it does not accept the inputs: another client may have them";
        }
        recipe_ = static_cast<unsigned char>(answer[0]);
        if (!ask('S', "", answer) || answer != "\1") {
            return "it does not start the exchange";
        }
        const unsigned int leave_after_ms = std::lround(1e3 * LEAVE_AFTER_S);
        setsockopt(socket_, IPPROTO_TCP, TCP_USER_TIMEOUT, &leave_after_ms, sizeof leave_after_ms);
        // Its first output follows.
        is_ready_ = false;
        at_s_ = clock_s();
        return nullptr;
    }

    // Time until the deadline of the handshake.
    int left_ms() const { return static_cast<int>(std::lround(1e3 * std::max(end_s_ - clock_s(), 0.0))); }

    static std::string registers(const std::string &way) {
        const std::string ints = way + "_int_register_", doubles = way + "_double_register_";
        return ints + "36," + ints + "37," + doubles + "36," + doubles + "37," + doubles + "38";
    }

    bool ask(char kind, const std::string &payload, std::string &answer) {
        if (!write(kind, payload)) {
            return false;
        }
        for (;;) {
            char found = 0;
            const int within_ms = left_ms();
            if (within_ms == 0) {
                return false;
            }
            if (next(found, answer)) {
                if (found == kind) {
                    return true;
                }
            } else if (!receive(within_ms)) {
                return false;
            }
        }
    }

    bool write(char kind, const std::string &payload) {
        std::string package;
        append(package, payload.size() + HEADER_BYTES, 2);
        package += kind + payload;
        return ::send(socket_, package.data(), package.size(), MSG_NOSIGNAL) == static_cast<ssize_t>(package.size());
    }

    // Takes what has arrived; with a time limit, waits for it. False if the connection is closed, or nothing came in time.
    bool receive(int within_ms) {
        pollfd ready{socket_, POLLIN, 0};
        if (within_ms > 0 && ::poll(&ready, 1, within_ms) != 1) {
            return false;
        }
        std::array<char, 4096> bytes;
        // Limited: a peer may send faster than this reads.
        for (std::size_t total = 0; total < READ_BYTES_MAX;) {
            const ssize_t count = recv(socket_, bytes.data(), bytes.size(), 0);
            if (count <= 0) {
                return count < 0 && (errno == EAGAIN || errno == EWOULDBLOCK);
            }
            received_.append(bytes.data(), static_cast<std::size_t>(count));
            total += static_cast<std::size_t>(count);
        }
        return true;
    }

    // The next package claims fewer bytes than its header has: where the one after it begins is unknown.
    bool is_malformed() const { return received_.size() >= 2 && number(received_, 0, 2) < HEADER_BYTES; }

    bool next(char &kind, std::string &payload) {
        if (received_.size() < HEADER_BYTES || is_malformed()) {
            return false;
        }
        const std::size_t size = number(received_, 0, 2);
        if (received_.size() < size) {
            return false;
        }
        kind = received_[2];
        payload = received_.substr(HEADER_BYTES, size - HEADER_BYTES);
        received_.erase(0, size);
        return true;
    }

    void take(double now_s, const std::string &payload) {
        activity_ = static_cast<std::int32_t>(number(payload, 1, 4));
        const auto sequence = static_cast<std::int32_t>(number(payload, 5, 4));
        position_ = {real(payload, 9), real(payload, 17), real(payload, 25)};
        is_ready_ = number(payload, 33, 4) == NORMAL && number(payload, 37, 4) == PLAYING && activity_ != PROTECTIVE;
        at_s_ = now_s;
        const auto sent = sent_at_s_.find(sequence);
        if (sent != sent_at_s_.end()) {
            if (answer_s_.size() < SAMPLES_MAX) {
                answer_s_.push_back(now_s - sent->second);
            }
            sent_at_s_.erase(sent);
        }
    }

    void lose(const char *why) {
        std::cerr << "cobot: " << why << std::endl;
        close_socket();
        sent_at_s_.clear();
    }
    void close_socket() {
        if (socket_ >= 0) {
            ::close(socket_);
        }
        socket_ = -1;
    }

    static constexpr double OUTPUT_HZ = 250.0;
    sockaddr_in address_{};
    bool is_valid_ = false, is_ready_ = false;
    int socket_ = -1, recipe_ = 0, activity_ = -1;
    double try_at_s_ = 0.0, at_s_ = -1.0, end_s_ = 0.0;
    std::int32_t sequence_ = 0;
    Position position_{0.0, 0.0, 0.0};
    std::string received_;
    std::map<std::int32_t, double> sent_at_s_;
    std::vector<double> answer_s_;
};

} // namespace equipoise::handover

#endif
