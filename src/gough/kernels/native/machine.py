"""This computer's processor, and machine code for it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property

import llvmlite.binding as llvm

llvm.initialize_native_target()
llvm.initialize_native_asmprinter()

QUICK_ABOVE = 8000
"""Operations above which code is generated without the slower optimisations."""


@dataclass(frozen=True)
class Machine:
    """A processor that code is made for."""

    triple: str
    cpu: str
    features: str

    @cached_property
    def width(self) -> int:
        """Lanes of float64 in the widest registers: 8, 4 or 2."""
        enabled = set(self.features.split(","))
        if {"+avx512f", "+avx512dq"} <= enabled:
            return 8
        return 4 if {"+avx2", "+fma"} <= enabled else 2

    def without(self, prefix: str) -> Machine:
        """The same processor without the features whose names start so."""
        kept = [f for f in self.features.split(",") if not f[1:].startswith(prefix)]
        names = [f[1:] for f in self.features.split(",") if f[1:].startswith(prefix)]
        return Machine(self.triple, self.cpu, ",".join([*kept, *(f"-{name}" for name in names)]))

    def key(self) -> str:
        """What machine code depends on besides its text."""
        version = ".".join(str(n) for n in llvm.llvm_version_info)
        return f"LLVM {version} small pic\n{self.triple}\n{self.cpu}\n{self.features}"

    def target(self, level: int) -> llvm.TargetMachine:
        """A code generator; each serves one engine."""
        return llvm.Target.from_triple(self.triple).create_target_machine(
            cpu=self.cpu,
            features=self.features,
            opt=level,
            reloc="pic",  # absolute addresses of constants need not fit in 32 bits
            codemodel="small",
            jit=True,
        )

    def object_code(self, text: str, level: int) -> bytes:
        """Machine code of a module; no passes run on the text before code is generated."""
        module = llvm.parse_assembly(f'target triple = "{self.triple}"\n{text}')
        code: bytes = self.target(level).emit_object(module)
        return code


@cache
def host() -> Machine:
    """The processor this process runs on."""
    features = llvm.get_host_cpu_features().flatten()
    return Machine(llvm.get_process_triple(), llvm.get_host_cpu_name(), features)


def level_for(operations: int) -> int:
    """Code generation level of a kernel; it depends on the size of the kernel alone."""
    return 0 if operations > QUICK_ABOVE else 2


class Loaded:
    """Machine code in memory; it stays as long as this object lives."""

    def __init__(self, code: bytes) -> None:
        machine = host()
        empty = llvm.parse_assembly(f'target triple = "{machine.triple}"')
        self._engine = llvm.create_mcjit_compiler(empty, machine.target(0))
        self._engine.add_object_file(llvm.ObjectFileRef.from_data(code))
        self._engine.finalize_object()

    def address(self, name: str) -> int:
        """Address of a function.

        Raises:
            ValueError: the code has no such function.
        """
        found = int(self._engine.get_function_address(name))
        if not found:
            raise ValueError(f"the machine code has no function {name}")
        return found
