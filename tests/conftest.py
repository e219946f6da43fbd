"""Set-up of all tests.

Hypothesis tries few random cases by default, many with --hypothesis-profile=long. Machine code is
kept in a folder of its own for each run.
"""

import os
import tempfile

from hypothesis import HealthCheck, settings

SLOW = [HealthCheck.too_slow, HealthCheck.data_too_large]
settings.register_profile("default", max_examples=60, deadline=None, suppress_health_check=SLOW)
settings.register_profile("long", max_examples=3000, deadline=None, suppress_health_check=SLOW)
settings.load_profile("default")

_cache = tempfile.TemporaryDirectory(prefix="gough-tests-")
if "PYTEST_XDIST_WORKER" not in os.environ:
    os.environ["GOUGH_CACHE_DIR"] = _cache.name  # workers take it over
