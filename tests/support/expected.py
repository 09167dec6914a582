"""Results that stand in a file beside their input: compared with it, or written by ``pytest --renew``."""

import functools
import json
import math
import re

import pytest


def cases(folder):
    """Every case of a folder's ``NAME.expected.json``, as parameters path and name of a case."""
    paths = sorted(folder.glob("*.expected.json"))
    return [
        pytest.param(path, case, id=f"{path.name.partition('.')[0]}: {case}")
        for path in paths
        for case in Expected.read(path)
    ]


def written_out(text):
    """A text of a case, in which ``<<c*n>>`` is a character n times."""
    return re.sub(r"<<(.)\*(\d+)>>", lambda match: match[1] * int(match[2]), text)


class Expected:
    """Whoever renews an expected result sees its test fail once, so that no result is taken over unseen."""

    def __init__(self, renew):
        self.renew = renew

    @staticmethod
    @functools.cache
    def read(path):
        """Every case of a file, which no test changes."""
        return json.loads(path.read_text(encoding="utf-8"))

    def text(self, path, text):
        """A text is that of a file."""
        if self.renew and (not path.exists() or path.read_text(encoding="utf-8") != text):
            path.write_text(text, encoding="utf-8")
            pytest.fail(f"renewed {path.name}")
        assert text == path.read_text(encoding="utf-8")

    def case(self, path, name, asked, result):
        """A result is what its case says besides the keys that ask for it."""
        every = self.read(path)
        known = {key: value for key, value in every[name].items() if key not in asked}
        if self.renew and not agree(known, result):
            every[name] = {key: value for key, value in every[name].items() if key in asked} | result
            path.write_text(as_json(every), encoding="utf-8")
            self.read.cache_clear()
            pytest.fail(f"renewed {path.name}: {name}")
        assert agree(known, result), f"{name}:\n{as_json({'expected': known, 'now': result})}"


def agree(expected, result):
    """Equal, numbers to nine digits."""
    if isinstance(expected, dict) and isinstance(result, dict):
        return expected.keys() == result.keys() and all(agree(expected[key], result[key]) for key in expected)
    if isinstance(expected, list) and isinstance(result, list):
        return len(expected) == len(result) and all(map(agree, expected, result))
    if isinstance(expected, float) and isinstance(result, int | float):
        return math.isclose(expected, result, rel_tol=1e-9, abs_tol=1e-15)
    return expected == result and isinstance(expected, bool) == isinstance(result, bool)


def rounded(value):
    """A value for JSON: floats with ten digits, nothing for what is no number."""
    if isinstance(value, dict):
        return {str(key): rounded(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [rounded(one) for one in value]
    if isinstance(value, float):
        return float(f"{value:.10g}") if math.isfinite(value) else None
    return value


def unmentioned(mentions, text):
    """The key words of a message that it lacks; what a mention begins with ``!`` it must not hold."""
    return [word for word in mentions if (word.removeprefix("!") in text) == word.startswith("!")]


def as_json(every):
    """A case after the other, each of its keys on one line."""
    bodies = []
    for name, case in every.items():
        lines = [f"    {json.dumps(key)}: {json.dumps(value, ensure_ascii=False)}" for key, value in case.items()]
        bodies.append(f"  {json.dumps(name)}: {{\n" + ",\n".join(lines) + "\n  }")
    return "{\n" + ",\n".join(bodies) + "\n}\n"
