"""The version: written here alone, and read by the build too, since asking for the installed one takes its time."""

VERSION = "0.2.0"
