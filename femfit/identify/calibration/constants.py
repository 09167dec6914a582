"""Constants of the calibration of a drawing."""

MOST_STEPS = 8
"""Numerical: numbers that have not settled after so many sweeps in a row follow no Gauss-Newton step."""

MOST_ROUNDS = 3
"""Numerical: how often what a calibrated drawing leaves is diagnosed again; each round needs a cause of its own."""

SETTLED = 0.1
"""Conventional: a step below this part of the standard deviations, root mean square, changes no conclusion."""

RISE = 1.0
"""Numerical: a step after which the weighted sum of squares is more than this larger is taken back and halved; less
changes no conclusion, and meshes differ."""

HALVINGS = 4
"""Numerical: a step that draws what cannot be built is halved so often."""

OPEN = 0.5
"""Conventional: a combination of numbers of whose tolerance, a standard deviation, the data leave more than this is not
said to be determined."""

SHOWN = 3
"""Conventional: more directions that are not determined are counted, not listed."""

ALIKE = 0.9
"""Conventional: numbers whose errors are correlated more than this are said not to be told apart."""

IN_COMBINATION = 0.1
"""Conventional: numbers with less than this part of the largest share of a combination are left out of its words."""

HELD = 0.25
"""Conventional: a number is said to be held by a tolerance that is assumed where more than this part of what is known
of it comes from there, or where that moves it by more than its error."""

UNUSUAL = 3.0
"""Conventional: a number that is more tolerances than this from its drawn value is to be checked otherwise."""
