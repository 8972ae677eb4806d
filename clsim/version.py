"""The version of the installed package."""

from importlib.metadata import PackageNotFoundError, version

try:
    VERSION = version("clsim")
except PackageNotFoundError:  # a plain checkout, not installed
    VERSION = "0+unknown"
