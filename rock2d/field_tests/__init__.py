"""Field tests: releases of real blocks on a real slope with known starts and stops."""
