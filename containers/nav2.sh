#!/bin/bash
# Start Nav2 with the parameters and the map of a folder, then run a command beside it: nav2 FOLDER COMMAND...
set -eo pipefail
folder=$1
shift
source /opt/ros/jazzy/setup.bash
ros2 launch nav2_bringup bringup_launch.py use_sim_time:=True autostart:=True \
  map:="$folder/map.yaml" params_file:="$folder/nav2_params.yaml" > nav2.log 2>&1 &
trap 'kill %1' EXIT
rvsg ros2 check
"$@"
