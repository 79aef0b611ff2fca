"""ROS 2 launch file: `ros2 launch ros/launch/jostle.launch.py policy:=dwa params:=robot.toml`.

`jostle-ros` is no ROS package, so it is started as a program; a process that ends is started again after two seconds.
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess
from launch.substitutions import LaunchConfiguration


def generate_launch_description() -> LaunchDescription:
    options = {
        "program": ("jostle-ros", "the program, if it is not on the path"),
        "policy": ("dwa", "a checkpoint file, a run folder or a planner's name"),
        "params": ("robot.toml", "parameters; jostle-ros --print-params writes a file with all of them"),
        "scan": ("/scan", "topic of the laser scans"),
        "odom": ("/odom", "topic of the odometry"),
        "goal": ("/goal_pose", "topic of the goals"),
        "cmd": ("/cmd_vel", "topic of the commands"),
    }
    arguments = [DeclareLaunchArgument(name, default_value=value, description=text) for name, (value, text) in options.items()]
    passed = ["policy", "params", "scan", "odom", "goal", "cmd"]
    command = [LaunchConfiguration("program")]
    for name in passed:
        command += [f"--{name}", LaunchConfiguration(name)]
    node = ExecuteProcess(cmd=command, output="screen", respawn=True, respawn_delay=2.0, sigterm_timeout="3")
    return LaunchDescription([*arguments, node])
