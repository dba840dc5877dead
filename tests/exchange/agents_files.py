"""Agents files in the three dialects of HuNavSim, as its users write them."""

FLAT = """\
hunav_loader:
  ros__parameters:
    map: cafe
    publish_people: true
    agents:
      - waiter
      - guest
    waiter:
      id: 1
      skin: 0
      behavior: 4
      group_id: -1
      max_vel: 1.5
      radius: 0.4
      init_pose: {x: 3.48, y: 6.93, z: 1.25, h: 0.0}
      goal_radius: 0.3
      cyclic_goals: true
      goals: [g0, g1]
      g0: {x: 3.37, y: -4.58, h: 1.25}
      g1: {x: -3.58, y: -4.79, h: 1.25}
    guest:
      id: 2
      behavior: 9
      max_vel: 0.9
      init_pose: {x: 0.0, y: 0.0, h: 0.5}
      goals: [g0]
      g0: {x: 1.0, y: 1.0}
"""

BLOCK = """\
hunav_loader:
  ros__parameters:
    map: map_of_room
    agents: [agent1]
    agent1:
      id: 1
      group_id: 2
      max_vel: 1.1
      radius: 0.35
      behavior:
        type: 5
        configuration: 1
        duration: 12.0
        once: false
        vel: 2.5
        dist: 1.2
        goal_force_factor: 1.0
        obstacle_force_factor: 12.0
        social_force_factor: 6.0
        other_force_factor: 18.0
      init_pose: {x: 1.0, y: 2.0, z: 1.25, h: 1.57}
      goal_radius: 0.2
      cyclic_goals: false
      goals: [g0, g1]
      g0: {x: 1.0, y: 2.0, h: 0.0}
      g1: {x: 4.0, y: 2.0, h: 0.0}
hunav_agent_manager:
  ros__parameters:
    publish_tf: true
"""

V2 = """\
hunav_loader:
  ros__parameters:
    yaml_base_name: ward
    simulator: Isaac Sim
    map: ward
    publish_people: true
    global_goals:
      1: {x: -6.77, y: -1.636}
      2: {x: -0.588, y: -1.458}
    agents: [nurse]
    nurse:
      id: 1
      skin: 1
      group_id: -1
      max_vel: 1.2
      radius: 0.4
      behavior: {type: Surprised, configuration: 2, once: true, front_dist: 1.4}
      init_pose: {x: -6.77, y: -1.636, z: 0.0, h: 0.0}
      goal_radius: 0.3
      cyclic_goals: true
      goals: [1, 2]
"""
