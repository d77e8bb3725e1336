"""The MJCF models: the robot (`kitasap2/`) and the places it lives in (`places/`)."""
