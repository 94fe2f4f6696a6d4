"""A survey on a cluster of processes gives the bits of a local one, also if a worker is killed on the way."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import numpy as np
from distributed import Client, LocalCluster

import armonic as am


def test_a_cluster_that_loses_a_worker_gives_the_bits_of_one_machine(tmp_path: Path) -> None:
    robot = am.load("scompi")
    axes = {
        "link_2.z": np.linspace(-0.5, 0.5, 60),
        "link_3.z": np.linspace(1, 2, 60),
        "link_4.z": np.linspace(0, 1, 40),
    }
    grid = am.Grid(axes, base="c8")
    local = am.survey(robot, grid)
    with (
        LocalCluster(n_workers=3, threads_per_worker=1, dashboard_address=None, silence_logs=50) as cluster,
        Client(cluster) as client,
    ):
        pids = list(client.run(os.getpid).values())
        killed = []

        def progress(done: int, total: int) -> None:
            if done > 0 and not killed:
                killed.append(pids[0])
                os.kill(pids[0], signal.SIGKILL)

        remote = am.survey(robot, grid, client=client, store=tmp_path / "map.zarr", progress=progress)
        assert killed
        for name in local.data_vars:
            np.testing.assert_array_equal(remote[name].values, local[name].values)
        by_address = am.survey(robot, "table", client=cluster.scheduler_address)
        np.testing.assert_array_equal(by_address.pole.values, am.survey(robot, "table").pole.values)
