"""``python -m femfit`` is the command ``femfit``."""

from femfit.cli.main import main

if __name__ == "__main__":
    main()
