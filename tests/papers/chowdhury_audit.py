"""What a published parameter set says of itself: dimensions, signs, bounds, range, coil, filter, precision.

python tests/papers/chowdhury_audit.py data/chowdhury2016.toml
"""

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from papers.parameter_audit.audit_parameters import audit_parameters
from papers.parameter_audit.parameters import read_parameters

from femfit.audit.audit_model import Audit


def main() -> None:
    """Print the findings."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("file", type=Path)
    findings = audit_parameters(read_parameters(parser.parse_args().file))
    sys.stdout.write(f"{Audit(tuple(findings))}\n")


if __name__ == "__main__":
    main()
