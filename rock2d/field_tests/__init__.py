"""Field tests: real blocks released on a real slope, of which starts and stops are known."""
