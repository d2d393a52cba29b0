"""Slope profiles as engineers have them: tables, drawings, terrain models; and the scenario that starts from one."""
