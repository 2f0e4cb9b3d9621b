"""The header compiles alone, as C and as C++, and a C++ program links the library built as C."""

import shutil
import subprocess
from pathlib import Path

import pytest

C = Path(__file__).resolve().parents[3] / "drivers" / "c"
STRICT = ["-Wall", "-Wextra", "-Werror", "-pedantic"]
PROGRAM = """
#include "hri_predict.h"
#include <cstdio>

int main()
{
    hri_receiver receiver;
    hri_settings settings = hri_settings();
    hri_robot_state state = hri_robot_state();
    hri_unit units[HRI_PARTS_STATE];
    settings.link = HRI_CLASSIC;
    settings.base_id = HRI_DEFAULT_BASE_ID;
    settings.silence_timeout_ms = 60;
    settings.max_age_ms = 204;
    state.joints = 6;
    bool ready = hri_init(&receiver, &settings);
    unsigned sent = hri_send_robot_state(&receiver, &state, 1, units);
    hri_receive_can(&receiver, units[0].id, false, false, units[0].data, units[0].length, 1);
    hri_receive_serial_byte(&receiver, 0, 1);
    sent += hri_acknowledge(&receiver, 7, 8, units);
    unsigned speed = hri_permitted_speed(&receiver, 1);
    std::printf("%d %u %u %s\\n", ready, sent, speed, hri_verdict_name(receiver.verdict));
    return 0;
}
"""


def compiler(name: str) -> str:
    found = shutil.which(name)
    if found is None:
        pytest.skip(f"no {name} here")
    return found


def run(*command: object) -> str:
    done = subprocess.run([*map(str, command)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize(
    ("name", "standard"), [("cc", "c99"), ("cc", "c11"), ("c++", "c++11"), ("c++", "c++17")]
)
def test_the_header_compiles_alone(tmp_path: Path, name: str, standard: str) -> None:
    unit = tmp_path / ("alone.c" if name == "cc" else "alone.cpp")
    unit.write_text('#include "hri_predict.h"\n#include "hri_predict.h"\nextern hri_unit unit;\n')
    run(compiler(name), f"-std={standard}", *STRICT, "-fsyntax-only", f"-I{C}", unit)


def test_a_cpp_program_links_the_library_built_as_c(tmp_path: Path) -> None:
    cc, cpp = compiler("cc"), compiler("c++")
    objects = []
    for source in sorted(C.glob("*.c")):
        objects.append(tmp_path / f"{source.stem}.o")
        run(cc, "-std=c99", *STRICT, "-c", "-o", objects[-1], source)
    main, program = tmp_path / "main.cpp", tmp_path / "program"
    main.write_text(PROGRAM)
    run(cpp, "-std=c++11", *STRICT, f"-I{C}", "-o", program, main, *objects)
    assert run(program) == "1 6 0 no schema\n"
