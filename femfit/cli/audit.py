"""``femfit audit``: a model or a published parameter set checked on its own."""

from pathlib import Path


def audit(file: Path, *, json: Path | None = None) -> None:
    """Check a model or a published parameter set on its own: dimensions, signs, bounds, range, coil, filter, precision.

    Parameters
    ----------
    file : Path
        Model file (.json), or a parameter set (.toml) such as data/chowdhury2016.toml.
    json : Path
        File for the findings as JSON.
    """
    from femfit.audit.audit_model import audit_model
    from femfit.audit.audit_parameters import audit_parameters
    from femfit.audit.finding import audit_lines
    from femfit.audit.parameters import read_parameters
    from femfit.cli.output import write_json
    from femfit.core.outputs import RESULT, require_outputs
    from femfit.model.json_file import read_model

    require_outputs([file], (json, RESULT))
    findings = audit_model(read_model(file)) if file.suffix == ".json" else audit_parameters(read_parameters(file))
    write_json(json, {"file": file.name, "findings": [one.to_dict() for one in findings]})
    print("\n".join(audit_lines(findings)))
