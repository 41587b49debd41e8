# SPDX-License-Identifier: Apache-2.0
"""Runs the tests of the package with pytest; exit status 77 where pytest or numpy is missing."""
import os
import sys

try:
    import numpy  # noqa: F401
    import pytest
except ImportError as error:
    print(f"python tests skipped: {error}; scripts/setup python installs what they need")
    sys.exit(77)
sys.exit(pytest.main(["-q", "-p", "no:cacheprovider", *sys.argv[1:],
                      os.path.dirname(os.path.abspath(__file__))]))
