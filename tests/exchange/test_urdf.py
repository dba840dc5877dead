"""What a URDF file says of a robot."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from rvsg.core.errors import FileError
from rvsg.robots.robot import load_robot
from rvsg_exchange.urdf import read_urdf

URDF = """<robot name="my robot">
  <link name="base_footprint"/>
  <link name="base_link">
    <collision><origin xyz="0.05 0 0.2"/><geometry><box size="0.8 0.5 0.3"/></geometry></collision>
  </link>
  <link name="wheel"><collision><geometry><cylinder radius="0.1" length="0.04"/></geometry></collision></link>
  <link name="laser"/>
  <joint name="a" type="fixed"><parent link="base_footprint"/><child link="base_link"/><origin xyz="0 0 0.1"/></joint>
  <joint name="b" type="continuous"><parent link="base_link"/><child link="wheel"/>
    <origin xyz="0 0.3 0" rpy="-1.5708 0 0"/><limit velocity="12" effort="1"/></joint>
  <joint name="c" type="fixed"><parent link="base_link"/><child link="laser"/>
    <origin xyz="0.4 0 0.1" rpy="0 0 0.5"/></joint>
  <gazebo reference="laser"><sensor name="front scan" type="gpu_ray"><update_rate>15</update_rate><ray>
    <scan><horizontal><samples>541</samples><min_angle>-2.0</min_angle><max_angle>2.4</max_angle></horizontal></scan>
    <range><min>0.1</min><max>20</max></range><noise><stddev>0.02</stddev></noise></ray></sensor></gazebo>
</robot>
"""


def written(folder: Path, text: str) -> Path:
    path = folder / "robot.urdf"
    path.write_text(text)
    return path


def test_outline_lidars_and_wheel_speed_are_read_and_with_the_missing_limits_it_is_a_robot_file(tmp_path: Path) -> None:
    values, missing = read_urdf(written(tmp_path, URDF))
    assert values["name"] == "my_robot"
    xs, ys = zip(*values["footprint"], strict=True)
    assert (min(xs), max(xs)) == pytest.approx((-0.35, 0.45))
    assert (min(ys), max(ys)) == pytest.approx((-0.25, 0.32), abs=1e-3)
    assert values["body_height_m"] == pytest.approx(0.45)
    assert values["limits"] == {"speed_m_s": 1.2, "reverse_m_s": 1.2}
    (lidar,) = values["lidars"]
    assert (lidar["x"], lidar["y"], lidar["height_m"]) == pytest.approx((0.4, 0.0, 0.2))
    assert (lidar["yaw"], lidar["field_of_view_rad"]) == pytest.approx((0.5 + 0.2, 4.4))
    assert (lidar["rays"], lidar["rate_hz"], lidar["noise_m"]) == (541, 15.0, 0.02)
    assert any("acceleration_m_s2" in sentence for sentence in missing)
    wanted = ("yaw_rate_rad_s", "acceleration_m_s2", "deceleration_m_s2", "yaw_acceleration_rad_s2")
    values["limits"] |= dict.fromkeys(wanted, 1.0)
    (tmp_path / "robot.yaml").write_text(yaml.safe_dump(values))
    assert load_robot(tmp_path / "robot.yaml").limits.speed_m_s == 1.2


@pytest.mark.parametrize(
    "text",
    [
        "<sdf/>",
        "<robot",
        '<robot name="a"/>',
        URDF.replace('size="0.8 0.5 0.3"', 'size="0.8 wide 0.3"'),
        '<robot name="a" xmlns:xacro="http://wiki.ros.org/xacro"><xacro:property name="x" value="1"/></robot>',
    ],
)
def test_what_is_no_urdf_is_one_message(tmp_path: Path, text: str) -> None:
    with pytest.raises(FileError):
        read_urdf(written(tmp_path, text))


def test_a_robot_of_meshes_says_what_is_missing(tmp_path: Path) -> None:
    mesh = '<collision><geometry><mesh filename="a.stl"/></geometry></collision>'
    values, missing = read_urdf(written(tmp_path, f'<robot name="a"><link name="base_link">{mesh}</link></robot>'))
    assert "footprint" not in values
    assert len([sentence for sentence in missing if sentence.startswith(("footprint", "lidars"))]) == 3
    assert values["lidars"] == []
