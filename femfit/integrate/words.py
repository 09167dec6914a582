"""What is remarked on coil records; the words stand in ``templates/findings.j2``."""

from femfit.core.words import Words

finding = Words("femfit.integrate", names={}).finding
