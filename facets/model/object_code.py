"""Machine code of the optics, compiled by llvmlite, stored, and called from Python.

Code is compiled for this processor, or for the processor of the environment variables FACETS_CPU
and FACETS_CPU_FEATURES.
"""

from __future__ import annotations

import contextlib
import ctypes
import gc
import hashlib
import io
import json
import os
import threading
from collections.abc import Callable, Iterator, Sequence
from functools import cache, partial
from pathlib import Path
from typing import Any

import llvmlite
import llvmlite.binding as llvm

from ..core.errors import OutputError
from ..files.whole import Whole
from .code_folder import code_folder, log_compilation

#: Writes a function's instructions with an `llvmlite` builder, from its arguments.
Write = Callable[[Any, Sequence[Any]], None]
#: Machine code of functions, by their names.
Objects = dict[str, bytes]
#: Stored objects begin with their SHA-256 checksum, so that damaged ones are compiled again.
DIGEST_BYTES = 32
MAKER = f"llvmlite {llvmlite.__version__}"
ADDITION = """define void @add(<8 x double>* %place) {
    %numbers = load <8 x double>, <8 x double>* %place
    %sums = fadd <8 x double> %numbers, %numbers
    store <8 x double> %sums, <8 x double>* %place
    ret void
}"""
#: A lock for each object, so that threads compile different objects at once, and none twice.
_LOCKS: dict[str, threading.Lock] = {}


def function(
    name: str, count: int, write: Callable[[], Write], *files: str | Path | None
) -> Callable[..., None]:
    """Return a function of `count` 64-bit integers, compiled if it is not stored.

    write: returns the writer of the code; only called to compile.  files: the files from which the
    code is made, in addition to the optics and the scalars. The function releases the interpreter's
    lock.
    """
    objects, passing = make_objects(name, count, write, *files)
    engine = load_objects(objects)
    start = ctypes.CFUNCTYPE(None, *[ctypes.c_int64] * count)(engine.get_function_address(name))
    start.keeps = engine, passing  # type: ignore[attr-defined]
    return start


def make_objects(
    name: str, count: int, write: Callable[[], Write], *files: str | Path | None
) -> tuple[Objects, object]:
    """The objects of a function and of the functions that it calls, and the owner of a temporary
    folder from `code_folder`."""
    folder, passing = code_folder(MAKER, __file__, *files)
    path = path_of(name, folder)
    with _LOCKS.setdefault(str(path), threading.Lock()):
        objects = read(path)
        if objects is None:
            log_compilation(passing)
            with collector_off():
                objects = compile_objects(name, module_of(name, count, write()))
            keep(path, objects)
    return objects, passing


@contextlib.contextmanager
def collector_off() -> Iterator[None]:
    """Switch Python's garbage collector off, which saves a tenth of the time of compiling."""
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()


def path_of(name: str, folder: Path) -> Path:
    """The file of a function's machine code for this processor."""
    return folder / f"{name}-{processor()[2]}.o"


@cache
def processor() -> tuple[str, str, str]:
    """The processor's name and features in LLVM's words, and a short name for both."""
    name = os.environ.get("FACETS_CPU") or "host"
    features = os.environ.get("FACETS_CPU_FEATURES")
    if features is None:
        features = host_features() if name == "host" else ""
    name = llvm.get_host_cpu_name() if name == "host" else name.replace("generic", "")
    return name, features, hashlib.sha256(f"{name} {features}".encode()).hexdigest()[:12]


@cache
def vector_bits() -> int:
    """The width of the registers in which LLVM adds numbers: 512, 256 or 128 bits.

    It is found from the code for the addition of eight numbers.
    """
    machine = new_machine()
    module = llvm.parse_assembly(ADDITION)
    module.triple = machine.triple
    code = machine.emit_assembly(module)
    return 512 if "zmm" in code else 256 if "ymm" in code else 128


def host_features() -> str:
    """The processor's features in LLVM's words; empty if LLVM does not know them."""
    try:
        return llvm.get_host_cpu_features().flatten()  # type: ignore[no-any-return]
    except RuntimeError:  # LLVM does not know the features: use those of the name
        return ""


def new_machine() -> Any:
    """Make the target machine for this processor; an engine takes ownership of it."""
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    name, features, _ = processor()
    target = llvm.Target.from_triple(llvm.get_process_triple())
    reloc = "static" if target.name.startswith("x86") else "default"
    return target.create_target_machine(
        cpu=name, features=features, opt=3, reloc=reloc, codemodel="jitdefault", jit=True
    )


def compile_objects(name: str, module: Any) -> Objects:
    """Compile a module with a function, and the functions that it calls.

    The object of a called function is stored for all callers.
    """
    from ..scalars.lanes import CALLED, write_callee

    machine = new_machine()
    parsed = llvm.parse_assembly(str(module))
    parsed.verify()
    keep_in_registers(parsed, machine)
    objects = {name: machine.emit_object(parsed)}
    for called in sorted(CALLED.keys() & module.globals.keys() - {name}):
        objects |= make_objects(called, 2, partial(partial, write_callee, called))[0]
    return objects


def module_of(name: str, count: int, write: Write) -> Any:
    """The module with the function that `write` writes; its string is LLVM's text."""
    from llvmlite import ir

    module, machine = ir.Module(name), new_machine()
    module.triple, module.data_layout = machine.triple, str(machine.target_data)
    kind = ir.FunctionType(ir.VoidType(), [ir.IntType(64)] * count)
    written = ir.Function(module, kind, name)
    builder = ir.IRBuilder(written.append_basic_block("entry"))
    write(builder, written.args)
    builder.ret_void()
    return module


def keep_in_registers(module: Any, machine: Any) -> None:
    """Run the only optimisation that the code needs.

    `scalars.tracing` has folded constants and removed duplicates; all of LLVM's optimisations would
    take a third of the compile time without faster code.
    """
    manager = llvm.create_new_function_pass_manager()
    passes = llvm.create_pass_builder(machine, llvm.create_pipeline_tuning_options())
    manager.add_sroa_pass()
    for function in module.functions:
        if not function.is_declaration:
            manager.run(function, passes)


def load_objects(objects: Objects) -> Any:
    """The engine that holds objects in memory and knows their functions' addresses."""
    machine, empty = new_machine(), llvm.parse_assembly("")
    empty.triple = machine.triple
    engine = llvm.create_mcjit_compiler(empty, machine)
    for code in objects.values():
        engine.add_object_file(llvm.ObjectFileRef.from_data(code))
    engine.finalize_object()
    return engine


def read(path: Path) -> Objects | None:
    """Read stored objects; None if they cannot be read or are damaged."""
    try:
        stored = path.read_bytes()
    except OSError:
        return None
    digest, content = stored[:DIGEST_BYTES], stored[DIGEST_BYTES:]
    if hashlib.sha256(content).digest() != digest:
        return None
    sizes, _, codes = content.partition(b"\n")
    file = io.BytesIO(codes)
    return {name: file.read(size) for name, size in json.loads(sizes).items()}


def keep(path: Path, objects: Objects) -> None:
    """Store objects in one step; if that fails they will be compiled again."""
    sizes = json.dumps({name: len(code) for name, code in objects.items()}).encode()
    content = b"\n".join([sizes, b"".join(objects.values())])
    with contextlib.suppress(OutputError), Whole(path, alone=True) as temporary:
        temporary.write_bytes(hashlib.sha256(content).digest() + content)
