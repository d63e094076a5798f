"""Command `pirrht ros`: a planner as a node of a ROS 2 graph."""

import argparse
from typing import Any

import numpy as np

from pirrht.errors import OptionError
from sim import options
from sim.cli.plan_command import notice
from sim.ros.graph import OPTIONS, Graph
from sim.ros.node import Node, NodeOptions
from sim.ros.planning import Work
from sim.text import counted, say

NODE = ("map_frame", "base_frame", "pose_from", "stamped", "late", "map_late", "max_speed", "max_turn")


def ros(arguments: argparse.Namespace) -> int:
    """Plan for a robot of a graph."""
    given = options.of_run("ros", vars(arguments))
    workspace: Any = given.pop("workspace", None)
    if workspace is not None and len(workspace) != 4:
        raise OptionError("--workspace must be X0 X1 Y0 Y1, of a robot on the ground")
    known: Any = {name: getattr(arguments, name) for name in NODE}
    options_of_node = NodeOptions(**known)
    work = Work(given, arguments.goal_radius, None if workspace is None else np.array(workspace), say)
    work.check()
    notice()
    graph = Graph.of(**{name: getattr(arguments, name) for name in OPTIONS})
    node = Node(graph, work, options_of_node, lambda line: print(line, flush=True))
    graph.check()
    try:
        node.run(lambda: arguments.once and node.arrived > 0)
    finally:
        if node.latencies:
            middle, most = 1e3 * np.percentile(node.latencies, (50, 99))
            print(
                f"{counted(len(node.latencies), 'command')}, {middle:.1f} ms after the odometry (99 %: {most:.1f} ms)",
                flush=True,
            )
    return 0
