"""Writes `servotune/asynchronous.pyi`: what type checkers are told of `AsyncClient`, from the client that scripts use.

Methods become coroutines, iterators asynchronous ones, a `Job` an `AsyncJob`; run as `python -m tests.support.stub`.
"""

from __future__ import annotations

import ast
import builtins
import subprocess
import sys
from collections.abc import Iterator
from functools import cached_property

from tests.support.distributions import ROOT

STUB = ROOT / "servotune" / "asynchronous.pyi"
_HEAD = "# What type checkers are told of `AsyncClient`. Written by `make stub`: change the client instead.\n"
_ENDS = (
    "self",
    "kind: type[BaseException] | None",
    "error: BaseException | None",
    "trace: TracebackType | None",
)
_OWN = {"__init__", "__aenter__", "__aexit__", "close"}


class Module:
    """A module of the client, as it is written."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.tree = ast.parse((ROOT / "servotune" / f"{name}.py").read_text())

    @cached_property
    def classes(self) -> dict[str, ast.ClassDef]:
        return {node.name: node for node in self.tree.body if isinstance(node, ast.ClassDef)}

    @cached_property
    def origins(self) -> dict[str, str]:
        """Return name -> the module that a stub imports it from."""
        found = {node.name: f"servotune.{self.name}" for node in self.tree.body if isinstance(node, ast.ClassDef)}
        for node in ast.walk(self.tree):
            if isinstance(node, ast.ImportFrom) and node.module:
                found |= {alias.name: node.module for alias in node.names}
        for node in self.tree.body:
            if isinstance(node, ast.Assign | ast.AnnAssign):
                targets = node.targets if isinstance(node, ast.Assign) else [node.target]
                found |= {one.id: f"servotune.{self.name}" for one in targets if isinstance(one, ast.Name)}
        return found


class Stub:
    """The stub as it grows: its classes, and what they import."""

    def __init__(self) -> None:
        self.imports: dict[str, set[str]] = {}
        self.modules = {path.stem: Module(path.stem) for path in (ROOT / "servotune").glob("*.py")}
        self.owners = {name: module for module in self.modules.values() for name in module.classes}

    def need(self, module: str, *names: str) -> None:
        self.imports.setdefault(module, set()).update(names)

    def annotation(self, node: ast.expr, module: Module, *, returned: bool = False) -> str:
        """Return an annotation as the stub has it, and import what it names."""
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and returned:
            node = ast.parse(node.value, mode="eval").body
        for one in ast.walk(node):
            if not isinstance(one, ast.Name):
                continue
            if one.id == "Job" and returned:
                one.id = "AsyncJob"
            elif one.id == "Iterator" and returned:
                one.id = "AsyncIterator"
                self.need("collections.abc", "AsyncIterator")
            elif one.id in module.origins:
                self.need(module.origins[one.id], one.id)
            else:
                assert hasattr(builtins, one.id), f"{module.name}: {one.id}"
        return ast.unparse(node)

    def method(self, node: ast.FunctionDef, module: Module) -> str:
        """Return a method, awaited; a property stays one."""
        arguments = node.args
        for one in (*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs, arguments.vararg, arguments.kwarg):
            if one is not None and one.annotation is not None:
                one.annotation = ast.parse(self.annotation(one.annotation, module), mode="eval").body
        arguments.defaults = [ast.Constant(...) for _ in arguments.defaults]
        arguments.kw_defaults = [default and ast.Constant(...) for default in arguments.kw_defaults]
        assert node.returns is not None, node.name
        returns = self.annotation(node.returns, module, returned=True)
        decorators = [ast.unparse(one) for one in node.decorator_list]
        assert set(decorators) <= {"property"}, node.name
        word = "def" if decorators or returns.startswith("AsyncIterator") else "async def"
        lead = "    @property\n" if decorators else ""
        return f"{lead}    {word} {node.name}({ast.unparse(arguments)}) -> {returns}: ..."

    def methods(self, name: str) -> Iterator[str]:
        """Yield the methods of a class, those of its bases first."""
        module = self.owners[name]
        definition = module.classes[name]
        for base in definition.bases:
            if isinstance(base, ast.Name) and base.id in self.owners:
                yield from self.methods(base.id)
        for node in definition.body:
            if isinstance(node, ast.FunctionDef) and not node.name.startswith("_") and node.name not in _OWN:
                yield self.method(node, module)

    def parts(self) -> dict[str, str]:
        """Return attribute -> class of what hangs at a client."""
        (made,) = (
            node for node in self.owners["Client"].classes["Client"].body if getattr(node, "name", "") == "__init__"
        )
        return {
            node.targets[0].attr: node.value.func.id
            for node in ast.walk(made)
            if isinstance(node, ast.Assign)
            and isinstance(node.targets[0], ast.Attribute)
            and isinstance(node.value, ast.Call)
            and isinstance(node.value.func, ast.Name)
        }

    def text(self) -> str:
        """Return the stub, as the formatter leaves it."""
        self.need("typing", "Any", "Generic", "Self", "type_check_only")
        self.need("types", "TracebackType")
        self.need("servotune.jobs", "ResultT")
        parts = self.parts()
        bodies = ["@type_check_only\nclass AsyncJob(Generic[ResultT]):\n" + "\n".join(self.methods("Job"))]
        bodies += [
            f"@type_check_only\nclass Async{name}:\n" + "\n".join(self.methods(name)) for name in sorted(parts.values())
        ]
        connect = self.modules["client"]
        (function,) = (node for node in connect.tree.body if getattr(node, "name", "") == "connect")
        assert isinstance(function, ast.FunctionDef)
        function.name, function.returns = "__init__", ast.Constant(None)
        function.args.args.insert(0, ast.arg("self"))
        attributes = [f"    {attribute}: Async{name}" for attribute, name in parts.items()]
        own = [
            self.method(function, connect).replace("async def", "def"),
            "    async def __aenter__(self) -> Self: ...",
            f"    async def __aexit__({', '.join(_ENDS)}) -> None: ...",
            "    async def close(self) -> None: ...",
        ]
        bodies.append("class AsyncClient:\n" + "\n".join([*attributes, *own, *self.methods("Client")]))
        imports = [f"from {module} import {', '.join(sorted(names))}" for module, names in sorted(self.imports.items())]
        return _formatted("\n".join([_HEAD, *imports, "", *bodies]) + "\n")


def _formatted(text: str) -> str:
    for command in (["check", "--fix", "--quiet", "--select", "I,F401"], ["format", "--quiet"]):
        done = subprocess.run(
            [sys.executable, "-m", "ruff", *command, "--stdin-filename", str(STUB), "-"],
            input=text, capture_output=True, text=True, check=True, cwd=ROOT,
        )  # fmt: skip
        text = done.stdout
    return text


if __name__ == "__main__":
    STUB.write_text(Stub().text())
