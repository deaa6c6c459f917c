"""Clients that others generate from the contract work: they are made of openapi/openapi.json and used against the running service."""

from __future__ import annotations

import json
import math
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.integration.api.conftest import Service, sqlite_service

__all__ = ["sqlite_service"]

HERE = Path(__file__).parent
ROOT = HERE.parents[2]
CONTRACT = ROOT / "openapi" / "openapi.json"
WEB = ROOT / "web"
#: x(t) = 2 (1 - exp(-t/τ)) goes from 10 to 90 % of its end in τ ln 9.
RISE = 0.2 * math.log(9)


def require_findings(found: dict[str, Any]) -> None:
    assert found["rise"] == pytest.approx(RISE, rel=1e-12)
    assert found["listed"] == [found["identifier"]]
    assert (found["curve"], found["verdict"]) == (11, "ok")
    assert (found["refused"], found["pointer"], found["gone"]) == (422, "/outputs/y", 204)


def run(*command: Any, **options: Any) -> str:
    done = subprocess.run(
        [str(part) for part in command], capture_output=True, text=True, timeout=300, check=False, **options
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_a_python_client_is_generated_and_works(sqlite_service: Service, tmp_path: Path) -> None:
    options = tmp_path / "options.yaml"
    # The generator knows files by this name only; it would format what it writes, which nobody reads here.
    options.write_text("content_type_overrides: {application/zip: application/octet-stream}\npost_hooks: []\n")
    said = run(
        Path(sys.executable).with_name("openapi-python-client"), "generate", "--path", CONTRACT, "--meta", "none",
        "--output-path", tmp_path / "contract_client", "--config", options, "--fail-on-warning",
    )  # fmt: skip
    assert "WARNING" not in said
    environment = {"PYTHONPATH": str(tmp_path)}
    found = run(sys.executable, HERE / "program.py", sqlite_service.url, sqlite_service.keys["admin"], env=environment)
    require_findings(json.loads(found))


@pytest.mark.skipif(
    not (WEB / "node_modules" / "openapi-typescript").is_dir(),
    reason="web/node_modules must hold openapi-typescript, it does not: `make web` installs it, as `make test` does",
)
def test_a_typescript_schema_is_generated_and_works(sqlite_service: Service, tmp_path: Path) -> None:
    (tmp_path / "node_modules").symlink_to(WEB / "node_modules")
    (tmp_path / "package.json").write_text('{"type": "module"}')
    shutil.copy(HERE / "contract.ts", tmp_path / "contract.ts")
    options = {"strict": True, "target": "es2022", "module": "nodenext", "types": [], "skipLibCheck": True}
    (tmp_path / "tsconfig.json").write_text(
        json.dumps({"compilerOptions": options | {"outDir": "out"}, "files": ["contract.ts"]})
    )
    steps = [
        # What has a default need not be sent.
        f"openapi-typescript {CONTRACT} -o {tmp_path}/schema.d.ts --default-non-nullable false",
        f"tsc -p {tmp_path}",
        f"node {tmp_path}/out/contract.js {sqlite_service.url} {sqlite_service.keys['admin']}",
    ]
    said = run(WEB / "npm", "exec", "--offline", "-c", " && ".join(steps))
    require_findings(json.loads(said.strip().splitlines()[-1]))
