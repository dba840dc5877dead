// A navigation stack in another process, for RVSG. One header, C++17, no dependency. Metres, seconds, radians.
//
//   struct MyPlanner : rvsg::Planner {
//     rvsg::Answer command(const rvsg::Observation &seen) override { return rvsg::velocity(0.3, 0.0); }
//   };
//   int main() { MyPlanner planner; return rvsg::serve(planner); }
//
// Build it with: g++ -O2 -std=c++17 my_planner.cpp -o my_planner
// Run it with:   rvsg simulate best_scenario.json --stack exec:./my_planner
// Write to standard error, never to standard output.
#pragma once

#include <cstdint>
#include <cstring>
#include <stdexcept>
#include <string>
#include <unistd.h>
#include <vector>

namespace rvsg {

struct Pose { double x, y, yaw; };

struct Task {
  std::uint64_t seed;
  double period, time_limit;
  double max_speed, max_reverse, max_yaw_rate;
  Pose start;                     // in the map frame
  std::vector<Pose> goals;        // in the map frame; the last one is the goal
  std::string robot_json;
  std::uint32_t map_rows, map_columns;
  double map_resolution, map_origin_x, map_origin_y;
  std::vector<std::uint8_t> map_cells;  // 0 free to 100 occupied, 255 unknown; row 0 has the smallest y
};

struct Scan {
  double t, angle_min, angle_increment, x, y, yaw;  // place of the lidar in the base frame
  std::vector<float> ranges;                        // infinite where a ray does not return
};

struct Person { float x, y, vx, vy; };

struct Observation {
  double t;
  Pose pose;                      // in the odom frame, like plan, goal, costmap and people
  double v, w;
  double lateral;                 // speed to the left; 0 for a base that does not move sideways
  Pose goal, map_from_odom;
  double costmap_x, costmap_y, costmap_resolution;
  std::uint32_t costmap_rows, costmap_columns;
  std::vector<float> plan;        // x0, y0, x1, y1, ...
  std::vector<std::uint8_t> costmap;  // 0 free, 253 inscribed, 254 lethal
  std::vector<Person> people;
  std::vector<Scan> scans;
};

struct Answer { std::uint8_t status; double v, w, lateral; };
inline Answer velocity(double v, double w) { return {1, v, w, 0.0}; }
inline Answer velocity(double vx, double vy, double wz) { return {1, vx, wz, vy}; }  // a base that moves sideways
inline Answer no_command() { return {0, 0.0, 0.0, 0.0}; }
inline Answer reached() { return {2, 0.0, 0.0, 0.0}; }   // whole stacks (exec-stack:) only
inline Answer gave_up() { return {3, 0.0, 0.0, 0.0}; }

struct Planner {
  bool wants_scans = true, wants_people = true, wants_costmap = true;
  virtual ~Planner() = default;
  virtual void hello(const std::string &json) { (void)json; }
  virtual void reset(const Task &task) { (void)task; }
  virtual Answer command(const Observation &seen) = 0;
};

namespace detail {

static_assert(sizeof(double) == 8 && sizeof(float) == 4, "IEEE 754 is expected");

class Reader {
 public:
  explicit Reader(const std::vector<std::uint8_t> &data) : data_(data) {}
  template <class T> T get() {
    T value;
    copy(&value, sizeof value);
    return value;
  }
  Pose pose() {
    const double x = get<double>(), y = get<double>(), yaw = get<double>();
    return {x, y, yaw};
  }
  template <class T> std::vector<T> many(std::size_t count) {
    if (count > data_.size()) throw std::runtime_error("a frame is shorter than it says");
    std::vector<T> values(count);
    if (count != 0) copy(values.data(), count * sizeof(T));
    return values;
  }

 private:
  void copy(void *to, std::size_t size) {
    if (at_ + size > data_.size()) throw std::runtime_error("a frame is shorter than it says");
    std::memcpy(to, data_.data() + at_, size);
    at_ += size;
  }
  const std::vector<std::uint8_t> &data_;
  std::size_t at_ = 0;
};

// Reads frames; what one call reads beyond a frame is kept for the next.
class Input {
 public:
  bool next(std::vector<std::uint8_t> &frame) {
    std::uint32_t size = 0;
    if (!fill(sizeof size)) return false;
    std::memcpy(&size, waiting_.data(), sizeof size);
    const std::size_t end = sizeof size + size;
    if (size == 0 || !fill(end)) return false;
    frame.assign(waiting_.begin() + sizeof size, waiting_.begin() + static_cast<std::ptrdiff_t>(end));
    std::memmove(waiting_.data(), waiting_.data() + end, held_ - end);
    held_ -= end;
    return true;
  }

 private:
  bool fill(std::size_t size) {
    if (waiting_.size() < size) waiting_.resize(size);
    while (held_ < size) {
      const ssize_t got = ::read(0, waiting_.data() + held_, waiting_.size() - held_);
      if (got <= 0) return false;
      held_ += static_cast<std::size_t>(got);
    }
    return true;
  }
  std::vector<std::uint8_t> waiting_ = std::vector<std::uint8_t>(1 << 16);
  std::size_t held_ = 0;
};

inline bool write_all(const void *from, std::size_t size) {
  const auto *at = static_cast<const std::uint8_t *>(from);
  while (size != 0) {
    const ssize_t put = ::write(1, at, size);
    if (put <= 0) return false;
    at += put;
    size -= static_cast<std::size_t>(put);
  }
  return true;
}

inline bool send(const std::string &frame) {
  const auto size = static_cast<std::uint32_t>(frame.size());
  std::string data(reinterpret_cast<const char *>(&size), 4);
  data += frame;
  return write_all(data.data(), data.size());
}

inline Task read_task(const std::vector<std::uint8_t> &frame) {
  Reader in(frame);
  in.get<char>();
  Task task{};
  task.seed = in.get<std::uint64_t>();
  task.period = in.get<double>();
  task.time_limit = in.get<double>();
  task.max_speed = in.get<double>();
  task.max_reverse = in.get<double>();
  task.max_yaw_rate = in.get<double>();
  task.start = in.pose();
  const auto goals = in.get<std::uint32_t>();
  for (std::uint32_t k = 0; k < goals; ++k) task.goals.push_back(in.pose());
  const auto robot = in.many<char>(in.get<std::uint32_t>());
  task.robot_json.assign(robot.begin(), robot.end());
  task.map_rows = in.get<std::uint32_t>();
  task.map_columns = in.get<std::uint32_t>();
  task.map_resolution = in.get<double>();
  task.map_origin_x = in.get<double>();
  task.map_origin_y = in.get<double>();
  task.map_cells = in.many<std::uint8_t>(std::size_t(task.map_rows) * task.map_columns);
  return task;
}

inline Observation read_observation(const std::vector<std::uint8_t> &frame, std::uint32_t &number, int protocol) {
  Reader in(frame);
  in.get<char>();
  Observation seen{};
  number = in.get<std::uint32_t>();
  seen.t = in.get<double>();
  seen.pose = in.pose();
  seen.v = in.get<double>();
  seen.w = in.get<double>();
  seen.goal = in.pose();
  seen.map_from_odom = in.pose();
  seen.costmap_x = in.get<double>();
  seen.costmap_y = in.get<double>();
  seen.costmap_resolution = in.get<double>();
  const auto points = in.get<std::uint32_t>();
  seen.costmap_rows = in.get<std::uint32_t>();
  seen.costmap_columns = in.get<std::uint32_t>();
  const auto persons = in.get<std::uint32_t>();
  const auto lidars = in.get<std::uint32_t>();
  if (protocol > 1) seen.lateral = in.get<double>();
  seen.plan = in.many<float>(2 * std::size_t(points));
  seen.costmap = in.many<std::uint8_t>(std::size_t(seen.costmap_rows) * seen.costmap_columns);
  seen.people = in.many<Person>(persons);
  for (std::uint32_t k = 0; k < lidars; ++k) {
    Scan scan{};
    const auto rays = in.get<std::uint32_t>();
    scan.t = in.get<double>();
    scan.angle_min = in.get<double>();
    scan.angle_increment = in.get<double>();
    scan.x = in.get<double>();
    scan.y = in.get<double>();
    scan.yaw = in.get<double>();
    scan.ranges = in.many<float>(rays);
    seen.scans.push_back(std::move(scan));
  }
  return seen;
}

inline std::string answer_frame(std::uint32_t number, const Answer &answer, int protocol) {
  std::string frame("V");
  frame.append(reinterpret_cast<const char *>(&number), 4);
  frame.append(reinterpret_cast<const char *>(&answer.status), 1);
  frame.append(reinterpret_cast<const char *>(&answer.v), 8);
  frame.append(reinterpret_cast<const char *>(&answer.w), 8);
  if (protocol > 1) frame.append(reinterpret_cast<const char *>(&answer.lateral), 8);
  return frame;
}

}  // namespace detail

// Answer until the other side closes; return 0 then. The machine must be little-endian.
inline int serve(Planner &planner) {
  detail::Input input;
  std::vector<std::uint8_t> frame;
  int protocol = 1;
  while (input.next(frame)) {
    const char kind = static_cast<char>(frame[0]);
    bool sent = true;
    if (kind == 'Q') return 0;
    if (kind == 'H') {
      const std::string hello(frame.begin() + 1, frame.end());
      // RVSG lists what it speaks: "protocols": [1, 2].
      protocol = hello.find("\"protocols\": [1, 2") != std::string::npos ? 2 : 1;
      planner.hello(hello);
      const auto flag = [](bool on) { return on ? "true" : "false"; };
      sent = detail::send(std::string("H{\"protocol\": ") + std::to_string(protocol) + ", \"scans\": " + flag(planner.wants_scans) +
                          ", \"people\": " + flag(planner.wants_people) +
                          ", \"costmap\": " + flag(planner.wants_costmap) + "}");
    } else if (kind == 'R') {
      planner.reset(detail::read_task(frame));
      sent = detail::send("R");
    } else if (kind == 'O') {
      std::uint32_t number = 0;
      const Observation seen = detail::read_observation(frame, number, protocol);
      sent = detail::send(detail::answer_frame(number, planner.command(seen), protocol));
    }
    if (!sent) return 0;
  }
  return 0;
}

}  // namespace rvsg
