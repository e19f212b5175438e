"""What every run needs: its folder, atomic files, devices, the console, ranks of processes."""
