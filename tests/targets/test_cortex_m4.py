"""The exported C on a Cortex-M4F: what a step costs in instructions, flash and stack, and that it estimates as here.

Compiled by zig's clang with -O2 as its Makefile does, run by the processor emulator unicorn: extra ``arm``.
"""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from femfit.estimate.kalman_filter import kalman_filter
from femfit.targets.c_code import export_c
from support.added_effects import usually
from support.readings import LASER

zig = pytest.importorskip("ziglang", reason="no compiler for the chip: the extra arm is not installed")
unicorn = pytest.importorskip("unicorn", reason="no emulator of the chip: the extra arm is not installed")
elffile = pytest.importorskip("elftools.elf.elffile", reason="no reader of programs: the extra arm is not installed")

pytestmark = pytest.mark.nightly

FLASH, RAM, HALT, ROOM = 0x0800_0000, 0x2000_0000, 0x3000_0000, 1 << 20

ERRORS = (f"__math_{name}f" for name in ("oflow", "uflow", "xflow", "divzero", "invalid"))
MATHEMATICS = ("expm1f", "powf", "powf_data", "exp2f_data", *ERRORS)

PROGRAM = """
#include "femfit_model.h"
femfit_filter filter;
femfit_real first[3], volts[FEMFIT_CIRCUITS], readings[FEMFIT_SENSORS];
__attribute__((noinline)) int begin(void) { return femfit_init(&filter, first); }
__attribute__((noinline)) int step(void) { return femfit_step(&filter, volts, readings, (1u << FEMFIT_SENSORS) - 1u); }
void _start(void) { begin(); step(); }
"""

PLACES = """
ENTRY(_start)
SECTIONS {
  . = 0x08000000; .text : { *(.text*) } .rodata : { *(.rodata*) } .ARM.exidx : { *(.ARM.exidx*) }
  . = 0x20000000; .data : { *(.data*) } .bss : { *(.bss*) *(COMMON) }
}
"""


def program(directory):
    """The linked filter; ``math.h`` and those of its functions that the compiler's library lacks are musl's."""
    (directory / "probe.c").write_text(PROGRAM)
    (directory / "probe.ld").write_text(PLACES)
    libc = Path(zig.__file__).parent / "lib/libc"
    compiler = [sys.executable, "-m", "ziglang", "cc", "-target", "thumb-freestanding-eabihf"]
    compiler += ["-mcpu=cortex_m4+vfp4d16sp", "-O2", "-g", "-std=c99", "-fno-unwind-tables", "-ffunction-sections"]
    strict = ["-Wall", "-Wextra", "-Wconversion", "-Wdouble-promotion", "-pedantic", "-Werror"]
    headers = [f"-isystem{libc / 'include' / name}" for name in ("generic-musl", "arm-linux-musl")]
    own = [f"-I{libc / 'musl' / name}" for name in ("src/internal", "src/include", "arch/arm", "arch/generic")]
    sources = {"probe.c": strict, "femfit_filter.c": strict, "femfit_arithmetic.c": strict}
    sources |= {str(libc / f"musl/src/math/{name}.c"): ["-w", *own] for name in MATHEMATICS}
    objects = [f"{Path(name).stem}.o" for name in sources]
    runs = [[*headers, *how, "-c", name, "-o", f"{Path(name).stem}.o"] for name, how in sources.items()]
    for run in (*runs, ["-Wl,--gc-sections", "-Wl,-T,probe.ld", "-o", "probe.elf", *objects]):
        subprocess.run([*compiler, *run], check=True, cwd=directory, timeout=300)
    return directory / "probe.elf"


class Chip:
    """A Cortex-M4F with a program of :func:`program`."""

    def __init__(self, path):
        with path.open("rb") as file:
            elf = elffile.ELFFile(file)
            self.symbols = {s.name: s["st_value"] for s in elf.get_section_by_name(".symtab").iter_symbols()}
            loaded = [s for s in elf.iter_sections() if s["sh_flags"] & 2 and s["sh_type"] != "SHT_NOBITS"]
            self.flash = sum(s["sh_size"] for s in loaded)
            self.machine = unicorn.Uc(unicorn.UC_ARCH_ARM, unicorn.UC_MODE_THUMB | unicorn.UC_MODE_MCLASS)
            self.machine.ctl_set_cpu_model(unicorn.arm_const.UC_CPU_ARM_CORTEX_M4)
            for place in (FLASH, RAM, HALT):
                self.machine.mem_map(place, ROOM)
            for section in loaded:
                self.machine.mem_write(section["sh_addr"], section.data())
        self.machine.hook_add(unicorn.UC_HOOK_CODE, self._counted)

    def _counted(self, machine, *_):
        self.instructions += 1
        self.stack = max(self.stack, RAM + ROOM - machine.reg_read(unicorn.arm_const.UC_ARM_REG_SP))

    def put(self, name, values):
        self.machine.mem_write(self.symbols[name], np.asarray(values, np.float32).tobytes())

    def call(self, name):
        """What a function of no arguments returns."""
        self.instructions = self.stack = 0
        self.machine.reg_write(unicorn.arm_const.UC_ARM_REG_SP, RAM + ROOM)
        self.machine.reg_write(unicorn.arm_const.UC_ARM_REG_LR, HALT | 1)
        self.machine.emu_start(self.symbols[name] | 1, HALT)
        return self.machine.reg_read(unicorn.arm_const.UC_ARM_REG_R0)

    def mean(self, count):
        return np.frombuffer(self.machine.mem_read(self.symbols["filter"], 4 * count), np.float32)


STATIC = ("coil_temperature", "magnet_temperature", "spring", "viscous_friction", "distance_offset", "current_gain")

CASES = {  # Instructions and bytes of flash, at most
    "ekf, three states": ("ekf", "laser", (), 2_500, 12_288),
    "ukf, three states": ("ukf", "laser", (), 6_600, 11_264),
    "ekf, Hall element": ("ekf", "hall", (), 3_700, 16_384),
    "ukf, Hall element": ("ukf", "hall", (), 10_300, 15_360),
    "ukf, six effects": ("ukf", "hall", STATIC, 12_000, 16_384),
    "ukf, hysteresis": ("ukf", "hall", ("hysteresis",), 53_000, 34_816),
    "ekf, saturating core": ("ekf", "hall", ("core_saturation",), 13_200, 26_624),
    "ukf, saturating core": ("ukf", "hall", ("core_saturation",), 31_000, 19_456),
}


@pytest.mark.parametrize("label", CASES)
def test_a_step_on_the_chip(levitation_model, tmp_path, label):
    kind, sensor, effects, most_instructions, most_flash = CASES[label]
    model = replace(usually(levitation_model, *effects), other_sensors=(LASER,))
    export_c(model, tmp_path / "c", (sensor,), kind, "float")
    chip, first = Chip(program(tmp_path / "c")), [0.022, 0.0, 0.4]
    filter_ = kalman_filter(model, kind, sensors=(sensor,))
    state = filter_.start(first)
    (output,) = filter_.process.outputs
    still, generator, most = filter_.process.measure(output.name, state.mean)[0], np.random.default_rng(0), 0
    chip.put("first", first)
    assert chip.call("begin") == 0
    for k in range(20):
        volts, reading = 0.5 + 0.4 * np.sin(0.1 * k), still + output.variance**0.5 * generator.standard_normal()
        chip.put("volts", [volts])
        chip.put("readings", [reading])
        assert chip.call("step") == 0
        most = max(most, chip.instructions)
        state = filter_.step(state, volts, np.array([reading]))
    error = np.abs(chip.mean(len(state.mean[0])) - state.mean[0]) / np.sqrt(np.diag(state.covariance[0]))
    costs = f"{most} instructions, {chip.flash} B of flash, {chip.stack} B of stack"
    print(f"\n{label}: {costs}; off by {error.max():.1g} deviations")  # noqa: T201  with -s
    assert error.max() < 0.01
    assert most <= most_instructions
    assert chip.flash <= most_flash
