"""``python -m clsim``."""

from clsim.cli import main

if __name__ == "__main__":
    main()
