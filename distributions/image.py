"""The image of the service: built from Containerfile, looked at, and kept in dist/ for machines without a registry.

    python distributions/image.py        (make image; make release, where podman or docker is installed)

Its parts are cut down, so what uses them is loaded in the finished image, as compose and Kubernetes run it: read-only and without capabilities.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parent.parent
NAME = "servotune"
LARGEST = 800_000_000
"""Bytes that it may have, Debian and Python among them."""
CHECK = """
import importlib, io, os
assert os.getuid() == 10001, "the image must not run as root"
for name in (
    "api.app", "api.commands.service", "engine", "optimizers.search", "storage.jobs.worker", "servotune.main", "numba", "psycopg", "obstore.store", "cryptography.fernet",
    "distributed", "dbos", "control", "cma", "pymoo.algorithms.moo.nsga2", "scipy.optimize", "scipy.signal", "matplotlib.pyplot", "fpdf", "PIL.Image", "lxml.etree",
    "asammdf", "h5py", "nptdms", "mcap.reader", "pint", "opentelemetry.exporter.otlp.proto.http.trace_exporter",
):
    importlib.import_module(name)
import cvxpy, pyarrow, pyarrow.parquet
for solver in ("CLARABEL", "SCS"):
    x = cvxpy.Variable()
    cvxpy.Problem(cvxpy.Minimize(x), [x >= 1]).solve(solver=solver)
    assert abs(x.value - 1) < 1e-3, solver
file = io.BytesIO()
pyarrow.parquet.write_table(pyarrow.table({"x": [1.0]}), file)
assert pyarrow.parquet.read_table(file)["x"].to_pylist() == [1.0]
"""


def main() -> None:
    """Build, look, keep.

    Raises
    ------
    SystemExit
        Where nothing builds images here, or the image is not what it must be.
    """
    engine = shutil.which("podman") or shutil.which("docker")
    if engine is None:
        raise SystemExit("an image is built by podman or docker, and neither is installed")

    def run(*words: str) -> str:
        done = subprocess.run([engine, *words], cwd=ROOT, stdout=subprocess.PIPE, text=True, check=False)  # noqa: S603 - our own words
        if done.returncode:
            raise SystemExit(f"{Path(engine).name} {words[0]} ended with {done.returncode}")
        return done.stdout.strip()

    run("build", "--file", "Containerfile", "--tag", NAME, ".")
    size = int(run("image", "inspect", "--format", "{{.Size}}", NAME))
    if size > LARGEST:
        raise SystemExit(f"the image must have at most {LARGEST / 1e6:.0f} MB, got {size / 1e6:.0f} MB")
    run("run", "--rm", "--read-only", "--tmpfs", "/tmp", "--cap-drop", "all", NAME, "python", "-c", CHECK)  # noqa: S108 - in the container
    target = ROOT / "dist" / f"{NAME}-image.tar"
    target.parent.mkdir(exist_ok=True)
    target.unlink(missing_ok=True)
    run("save", "--output", str(target), NAME)
    sys.stdout.write(f"{target}: {size / 1e6:.0f} MB\n")


if __name__ == "__main__":
    main()
