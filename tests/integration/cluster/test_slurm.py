"""Workers that a real SLURM starts, as the documentation has it: jobs of its queue that come when a search asks for them."""

from __future__ import annotations

import os
import pwd
import shutil
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest
from distributed.security import Security

from api.processes.cluster import Cluster
from optimizers.evaluation.processes import Processes
from optimizers.evaluation.spreading import spread
from optimizers.solving.solve import solve
from tests.integration.cluster.conftest import ROOT, certificate
from tests.integration.cluster.test_cluster import EAGER, VALLEYS, plain
from tests.support.desk import wait_for
from tests.support.patience import PATIENCE

PATH = os.pathsep.join([os.environ.get("PATH", ""), "/usr/sbin"])
NEEDED = ("munged", "slurmctld", "slurmd", "sbatch", "sinfo")
MISSING = [name for name in NEEDED if shutil.which(name, path=PATH) is None]

pytestmark = [
    pytest.mark.skipif(
        bool(MISSING), reason=f"no {', '.join(MISSING)} on this machine (Debian: slurmctld slurmd munge)"
    ),
    pytest.mark.skipif(os.geteuid() != 0, reason="SLURM's daemon starts jobs of users, which only root may"),
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
]

#: One node of one processor, this machine, with nothing that would need a system around it.
CONFIGURATION = """
ClusterName=one
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={controller}
SlurmdPort={daemon}
SlurmUser=root
AuthType=auth/munge
AuthInfo=socket={folder}/munge.socket
CredType=cred/munge
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
ReturnToService=2
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
SlurmdSpoolDir={folder}/spool
StateSaveLocation={folder}/state
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd.log
NodeName={host} NodeAddr=127.0.0.1 CPUs=1 State=UNKNOWN
PartitionName=all Nodes={host} Default=YES State=UP
"""


def free_ports(count: int) -> list[int]:
    held = [socket.create_server(("127.0.0.1", 0)) for _ in range(count)]
    ports = [int(server.getsockname()[1]) for server in held]
    for server in held:
        server.close()
    return ports


@pytest.fixture
def slurm(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A SLURM of one node, in the foreground of this test; gives a folder that it may write to."""
    folder = tmp_path_factory.mktemp("slurm")
    for name in ("spool", "state"):
        (folder / name).mkdir()
    (folder / "munge.key").write_bytes(os.urandom(1024))
    (folder / "munge.key").chmod(0o400)
    controller, daemon = free_ports(2)
    (folder / "slurm.conf").write_text(
        CONFIGURATION.format(
            host=socket.gethostname().partition(".")[0], folder=folder, controller=controller, daemon=daemon
        )
    )  # fmt: skip
    monkeypatch.setenv("SLURM_CONF", str(folder / "slurm.conf"))
    monkeypatch.setenv("PATH", PATH)
    munged = [
        "munged", "--foreground", "--force", f"--key-file={folder}/munge.key", f"--socket={folder}/munge.socket",
        f"--pid-file={folder}/munge.pid", f"--seed-file={folder}/munge.seed", f"--log-file={folder}/munge.log",
    ]  # fmt: skip
    running: list[subprocess.Popen[bytes]] = []
    try:
        with (folder / "log").open("wb") as log:
            for command, ready in (
                (munged, (folder / "munge.socket").exists),
                (["slurmctld", "-D"], lambda: told("sinfo", "-h", "-o", "%P") == "all*"),
                (["slurmd", "-D"], lambda: told("sinfo", "-h", "-o", "%t") == "idle"),
            ):
                running.append(subprocess.Popen(command, stdout=log, stderr=log))
                wait_for(ready, command[0])
        yield folder
    finally:
        subprocess.run(["scancel", "--user", pwd.getpwuid(os.geteuid()).pw_name], capture_output=True, check=False)
        for process in reversed(running):
            process.terminate()
            process.wait()


def told(*command: str) -> str:
    return subprocess.run(command, capture_output=True, text=True, check=False).stdout.strip()


def test_workers_come_from_the_queue_when_a_search_asks_for_them(slurm: Path) -> None:
    from dask_jobqueue import SLURMCluster

    files = certificate(slurm)
    both = {
        f"tls_{who}_{what}": files[f"tls_client_{what}"] for who in ("worker", "scheduler") for what in ("cert", "key")
    }
    asked = SLURMCluster(
        cores=1, memory="1GB", processes=1, walltime="00:10:00", protocol="tls",
        security=Security(require_encryption=True, **files, **both),
        scheduler_options={"host": "127.0.0.1", "port": 0, "dashboard_address": "127.0.0.1:0"},
        python=sys.executable, job_script_prologue=[f"export PYTHONPATH={ROOT}"], job_directives_skip=["--mem"],
        log_directory=str(slurm), local_directory=str(slurm),
    )  # fmt: skip
    options = {"points": 40, "refine": 1}
    alone = solve("grid", VALLEYS, options)
    with closing(asked):
        asked.adapt(minimum=0, maximum=2)
        assert told("squeue", "-h") == ""
        workers = Cluster(asked.scheduler_address, security=files, adaptive=2, here=Processes(1))
        with spread(workers, **EAGER, patience=PATIENCE) as over:
            together = solve("grid", VALLEYS, options)
        assert over.sent > 0
        assert over.left == 0
    assert plain(together) == plain(alone)
