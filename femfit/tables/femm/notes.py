"""What is said while a FEMM model is imported: problems, which refuse it, and findings, which come with the result."""

from dataclasses import dataclass, field

from femfit.core.finding import Finding


@dataclass(frozen=True)
class Notes:
    """Filled by the steps of an import, each in its turn."""

    problems: list[str] = field(default_factory=list)
    findings: list[Finding] = field(default_factory=list)

    def problem(self, text: str) -> None:
        """Refuse the model, when everything was looked at."""
        self.problems.append(text)

    def info(self, code: str, text: str, remedy: str = "") -> None:
        """Say what was done."""
        self.findings.append(Finding(code, "info", text, remedy))

    def warn(self, code: str, text: str, remedy: str = "", size: float | None = None) -> None:
        """Say what the user should look at."""
        self.findings.append(Finding(code, "warning", text, remedy, size))
