"""The sweep on a cluster gives the rows of the native sweep, and survives the loss of a worker.

Needs the packages of `requirements-sweep.txt` and pytest, and the FMUs and the program built by `cargo build --release`.
"""

import os
import pathlib
import signal
import subprocess
import threading
import time

import dask
import pytest
from distributed import Client, LocalCluster

import sweep

HERE = pathlib.Path(__file__).resolve().parent.parent
PROGRAM = HERE / "target" / "release" / "magnetic-bearing"
DESIGNS = HERE / "tests" / "designs"


def native(*arguments):
    done = subprocess.run([PROGRAM, "sweep", *map(str, arguments)], capture_output=True, text=True)
    # Failed cases have rows too, and are counted.
    assert done.returncode == 0 or "cases failed" in done.stderr, done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def ssp(tmp_path_factory):
    folder = tmp_path_factory.mktemp("fmu")
    subprocess.run([PROGRAM, "package", "--out", folder], check=True, capture_output=True)
    return (folder / "MagneticBearing.ssp").read_bytes()


@pytest.fixture(scope="module")
def client():
    dask.config.set({"distributed.scheduler.allowed-failures": 10})
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster, Client(cluster) as client:
        yield client


def scenario():
    return (sweep.SCENARIOS / "unbalanced.toml").read_text(encoding="utf-8")


def test_rows_are_those_of_the_native_sweep_to_the_last_byte(tmp_path, client, ssp):
    native(DESIGNS / "cases.csv", "--out", tmp_path / "native.csv")
    sweep.sweep(client, DESIGNS / "cases.csv", tmp_path / "cluster.csv", scenario(), ssp)
    assert (tmp_path / "cluster.csv").read_text() == (tmp_path / "native.csv").read_text()


def test_rows_of_another_machine_are_those_of_the_native_sweep(tmp_path, client):
    subprocess.run([PROGRAM, "package", "spindle4", "--out", tmp_path], check=True, capture_output=True)
    text = (sweep.SCENARIOS / "spindle4.toml").read_text(encoding="utf-8").replace('duration = "0.4 s"', 'duration = "0.1 s"')
    (tmp_path / "short.toml").write_text(text, encoding="utf-8")
    (tmp_path / "design.csv").write_text("plant.A.lambda[2],plant.MY [N.m]\n3e-6,0.1\n,-1\n")
    native(tmp_path / "design.csv", "--scenario", tmp_path / "short.toml", "--out", tmp_path / "native.csv")
    archive = (tmp_path / "MagneticSpindle4.ssp").read_bytes()
    sweep.sweep(client, tmp_path / "design.csv", tmp_path / "cluster.csv", text, archive)
    assert (tmp_path / "cluster.csv").read_text() == (tmp_path / "native.csv").read_text()


def test_a_lost_worker_loses_no_row(tmp_path, client, ssp):
    design = tmp_path / "design.csv"
    # Enough cases to lose a worker during the sweep.
    design.write_text("".join(native(DESIGNS / "hypercube.toml", "--expand").splitlines(keepends=True)[:13]))
    native(design, "--out", tmp_path / "native.csv")
    killed = []

    def kill():
        # Once there are rows, workers are busy.
        while not (tmp_path / "cluster.csv").exists() or len((tmp_path / "cluster.csv").read_text().splitlines()) < 5:
            time.sleep(0.01)
        victim = client.run(os.getpid, workers=[next(iter(client.scheduler_info()["workers"]))])
        for process in victim.values():
            os.kill(process, signal.SIGKILL)
            killed.append(process)

    # A daemon, because after a failed sweep it waits for rows for ever.
    killer = threading.Thread(target=kill, daemon=True)
    killer.start()
    sweep.sweep(client, design, tmp_path / "cluster.csv", scenario(), ssp)
    killer.join(timeout=60)
    assert len(killed) == 1, "nothing was killed: the sweep was over too early"
    assert (tmp_path / "cluster.csv").read_text() == (tmp_path / "native.csv").read_text()


def test_either_sweep_resumes_from_the_rows_of_the_other(tmp_path, client, ssp):
    native(DESIGNS / "cases.csv", "--out", tmp_path / "whole.csv")
    lines = (tmp_path / "whole.csv").read_text().splitlines(keepends=True)
    (tmp_path / "rows.csv").write_text("".join([lines[0], lines[4], lines[2], lines[5], lines[3], lines[6][:30]]))
    assert sweep.sweep(client, DESIGNS / "cases.csv", tmp_path / "rows.csv", scenario(), ssp) == 2
    assert (tmp_path / "rows.csv").read_text() == "".join(lines)


@pytest.mark.parametrize("value", [0.0, 1.0, -1.5e-6, 1e8, 0.1, 123456.789, 5e-324, 1.7976931348623157e308])
def test_numbers_are_read_back_exactly(value):
    assert float(sweep.shortest(value)) == value
