"""What goes with the wheels of a release in dist/: the bill of materials of the image (CycloneDX), the licences of its parts, sums.

    python distributions/release.py [KEY]        (make release, make release KEY=..., build the wheels first)

With the file of an SSH key the sums are signed: SHA256SUMS.sig, which `ssh-keygen -Y verify` holds against the key's public half.

The parts are those that the image runs (requirements-image.lock), as they are installed here: their versions are the same in
requirements.lock. Facts on licences are those that each package states of itself, and ``STATED`` where it states none in words
that a program reads.
"""

from __future__ import annotations

import hashlib
import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parent.parent
STATED = {
    "graphemeu": "MIT",
    "partd": "BSD-3-Clause",
    "protobuf": "BSD-3-Clause",
    "qdldl": "Apache-2.0",
    "zstd": "BSD-2-Clause",
}
"""Package -> the licence that its text is."""
LEFT_OUT = {"setuptools", "sparsediffpy"}
"""What the image leaves out again, for nothing in it asks for them: see Containerfile."""
NAMESPACE = "servotune-release"
"""What a signature is for: it is none of anything else that the key signs."""
_CLASSIFIER = "License :: OSI Approved :: "


def parts() -> list[str]:
    """Return the names of what the image runs, in the spelling of an index."""
    lock = (ROOT / "requirements-image.lock").read_text(encoding="utf-8")
    locked = {_spelled(name) for name in re.findall(r"^([A-Za-z0-9._-]+)==", lock, flags=re.MULTILINE)}
    return sorted(locked - LEFT_OUT)


def bill() -> dict[str, Any]:
    """Return the bill of materials of the parts, as CycloneDX has it.

    Raises
    ------
    SystemExit
        Where one of them is not installed here.
    """
    command = [sys.executable, "-m", "cyclonedx_py", "environment", "--output-format", "JSON", "--output-reproducible"]
    # Validation takes half a minute, and would be of all that is installed here: a test validates the bill.
    command.append("--no-validate")
    written = subprocess.run(command, capture_output=True, text=True, check=True).stdout  # noqa: S603 - our own words
    found: dict[str, Any] = json.loads(written)
    wanted = set(parts())
    found["components"] = [entry for entry in found["components"] if _spelled(entry["name"]) in wanted]
    missing = wanted - {_spelled(entry["name"]) for entry in found["components"]}
    if missing:
        raise SystemExit(f"all parts of the image must be installed here, these are not: {', '.join(sorted(missing))}")
    for entry in found["components"]:
        stated = STATED.get(_spelled(entry["name"]))
        if stated is not None and "licenses" not in entry:
            entry["licenses"] = [{"license": {"id": stated}}]
    references = {entry["bom-ref"] for entry in found["components"]}
    found["dependencies"] = [
        {**entry, "dependsOn": [other for other in entry.get("dependsOn", ()) if other in references]}
        for entry in found.get("dependencies", ())
        if entry["ref"] in references
    ]
    return found


def licence(component: dict[str, Any]) -> str:
    """Return the licence of a part, empty where nobody states one."""
    told = []
    for entry in component.get("licenses", ()):
        own = entry.get("license", {})
        told.append(entry.get("expression") or own.get("id") or own.get("name") or "")
    return " / ".join(sorted({" ".join(each.removeprefix(_CLASSIFIER).split())[:80] for each in told if each}))


def licences(found: dict[str, Any]) -> str:
    """Return a page that lists the parts with version and licence."""
    lines = [
        f"| {entry['name']} | {entry['version']} | {licence(entry)} |"
        for entry in sorted(found["components"], key=lambda entry: _spelled(entry["name"]))
    ]
    return "\n".join(
        ["# Licences of what the image runs", "", "| part | version | licence |", "|---|---|---|", *lines, ""]
    )


def sums(folder: Path) -> str:
    """Return the SHA-256 of every file, as `sha256sum --check` reads them."""
    files = sorted(path for path in folder.iterdir() if path.is_file() and not path.name.startswith("SHA256SUMS"))
    lines = []
    for path in files:
        with path.open("rb") as file:
            lines.append(f"{hashlib.file_digest(file, 'sha256').hexdigest()}  {path.name}\n")
    return "".join(lines)


def sign(file: Path, key: Path) -> Path:
    """Sign a file with an SSH key; return the signature, which lies beside it.

    Raises
    ------
    SystemExit
        Where the key cannot sign.
    """
    signature = file.with_name(f"{file.name}.sig")
    signature.unlink(missing_ok=True)  # it would ask whether to write over it
    command = ["ssh-keygen", "-Y", "sign", "-q", "-f", str(key), "-n", NAMESPACE, str(file)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603 - our own words
    if done.returncode or not signature.is_file():
        raise SystemExit(f"the key must be an SSH key that signs, {key} is none: {done.stderr.strip()}")
    return signature


def _spelled(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


if __name__ == "__main__":
    target = ROOT / "dist"
    target.mkdir(exist_ok=True)
    made = bill()
    (target / "sbom.cdx.json").write_text(json.dumps(made, indent=1) + "\n", encoding="utf-8")
    (target / "licences.md").write_text(licences(made), encoding="utf-8")
    (target / "SHA256SUMS").write_text(sums(target), encoding="utf-8")
    sys.stdout.write(f"{target}: sbom.cdx.json, licences.md ({len(made['components'])} parts) and SHA256SUMS\n")
    if sys.argv[1:]:
        sys.stdout.write(f"{sign(target / 'SHA256SUMS', Path(sys.argv[1])).name}\n")
