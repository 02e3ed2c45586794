// A usable overload of a station, or none, by the rules of docs/consumers/ros2.md. Not compiled.
#pragma once

#include <cstdint>
#include <cstdlib>
#include <string>

#include <equipoise_msgs/msg/state.hpp>
#include <rclcpp/rclcpp.hpp>

using State = equipoise_msgs::msg::State;

class Equipoise
{
public:
  // Topic of a station's states. Stations whose names differ only in characters that ROS 2 does not allow share it.
  static std::string topic(const std::string & station)
  {
    std::string name;
    for (const char letter : station) {
      const bool is_digit = letter >= '0' && letter <= '9';
      const bool is_letter = (letter >= 'a' && letter <= 'z') || (letter >= 'A' && letter <= 'Z');
      // A character of several bytes becomes one _.
      const bool is_inside = (static_cast<unsigned char>(letter) & 0xc0) == 0x80;
      if (name.empty() && is_digit) {name += '_';}
      if (!is_inside) {name += is_digit || is_letter ? letter : '_';}
    }
    return "/equipoise/" + name + "/state";
  }

  explicit Equipoise(rclcpp::Node & node, const std::string & station = "station-1")
  : subscription_(node.create_subscription<State>(
        topic(station), rclcpp::QoS(1).best_effort(),
        [this, station](State::ConstSharedPtr state) {
          if (state->station == station) {last_ = state; received_ = steady_.now();}
        }))
  {
  }

  // nullptr: no usable value. Valid until the next message.
  const equipoise_msgs::msg::Overload * overload()
  {
    if (!last_ || !last_->current || last_->age_ns.empty()) {return nullptr;}         // see last_->no_state_reason
    const auto waited = (steady_.now() - received_).nanoseconds();    // since the callback, not since the arrival
    if (static_cast<int64_t>(last_->age_ns[0]) + waited > 100'000'000) {return nullptr;}
    const auto old = (wall_.now() - rclcpp::Time(last_->header.stamp, RCL_SYSTEM_TIME)).nanoseconds();
    if (std::abs(old) > 100'000'000) {return nullptr;}            // only with synchronised clocks
    return last_->overload.empty() ? nullptr : &last_->overload[0];                   // see last_->reasons
  }

private:
  rclcpp::Clock steady_{RCL_STEADY_TIME}, wall_{RCL_SYSTEM_TIME};
  rclcpp::Time received_{0, 0, RCL_STEADY_TIME};
  State::ConstSharedPtr last_;
  rclcpp::Subscription<State>::SharedPtr subscription_;
};
