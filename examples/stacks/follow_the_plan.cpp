// The planner of follow_the_plan.py in C++. Get the header with: rvsg stacks --write-clients .
#include <algorithm>
#include <cmath>

#include "rvsg_client.hpp"

struct FollowThePlan : rvsg::Planner {
  double turn = 1.0;

  FollowThePlan() { wants_scans = wants_people = false; }

  void reset(const rvsg::Task &task) override { turn = task.max_yaw_rate; }

  rvsg::Answer command(const rvsg::Observation &seen) override {
    const std::size_t count = seen.plan.size() / 2;
    const auto away = [&](std::size_t k) {
      return std::hypot(seen.plan[2 * k] - seen.pose.x, seen.plan[2 * k + 1] - seen.pose.y);
    };
    std::size_t target = 0;
    for (std::size_t k = 1; k < count; ++k) if (away(k) < away(target)) target = k;
    while (target + 1 < count && away(target) < 0.6) ++target;
    const double heading = std::atan2(seen.plan[2 * target + 1] - seen.pose.y, seen.plan[2 * target] - seen.pose.x);
    const bool arrived = away(count - 1) < 0.2;
    const double error = std::remainder((arrived ? seen.goal.yaw : heading) - seen.pose.yaw, 2.0 * M_PI);
    if (arrived || std::abs(error) > 0.8) return rvsg::velocity(0.0, std::clamp(2.0 * error, -turn, turn));
    return rvsg::velocity(0.5, std::sin(error) / 0.6);
  }
};

int main() {
  FollowThePlan planner;
  return rvsg::serve(planner);
}
