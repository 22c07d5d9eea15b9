"""The figures of the paper that ours stand beside: Lu et al., "FasTac", on its own sensor and board."""

GRADIENT_MAE_MM_PER_PX = {
    "bgr": {"x": 0.0047, "y": 0.0051, "total": 0.0098},
    "bgr+nir": {"x": 0.0028, "y": 0.0040, "total": 0.0068},
}
"""Table of gradient errors, by channels and component."""
GRADIENT_REDUCTION_PERCENT = {"x": 40, "y": 22, "total": 31}
"""Of RGB-NIR below RGB, same table."""
DEPTH_MAE_MM = {
    "bgr": {"prior": 0.0618, "no_prior": 0.2730},
    "bgr+nir": {"prior": 0.0415, "no_prior": 0.2686},
}
"""Table of depth errors, by channels and boundary."""
FORCE_MAE_N = {
    ("dynamic", "xy"): (0.0386, 0.0279, 0.1570),
    ("dynamic", "z"): (0.0235, 0.0325, 0.0589),
    ("dynamic", "xyz"): (0.0235, 0.0246, 0.0545),
    ("fixed", "xy"): (0.0545, 0.0318, 0.5123),
    ("fixed", "z"): (0.1028, 0.0637, 0.4980),
    ("fixed", "xyz"): (0.0516, 0.0344, 0.4905),
}
"""Of F_x, F_y, F_z, by kernel and inputs: table of force modes."""
FORCE_FULL = {
    "nmae_percent": (2.37, 2.41, 2.74),
    "nrmse_percent": (3.15, 3.33, 3.72),
    "r2": (0.9921, 0.9873, 0.9690),
}
"""Of the dynamic kernel with all three inputs; section "Three-Axis Force Sensing Evaluation"."""
STAGES = {
    "normals": {
        "CPU": {"latency_ms": 2.40, "gradient_mae_mm_per_px": 0.0456, "energy_mj": 74.83},
        "GPU": {"latency_ms": 0.30, "gradient_mae_mm_per_px": 0.0456, "energy_mj": 3.00},
        "FPGA": {"latency_ms": 0.11, "gradient_mae_mm_per_px": 0.0508, "energy_mj": 0.29},
    },
    "depth": {
        "CPU": {"latency_ms": 1.17, "depth_mae_mm": 0.0496, "energy_mj": 21.51},
        "GPU": {"latency_ms": 1.34, "depth_mae_mm": 0.0496, "energy_mj": 17.28},
        "FPGA": {"latency_ms": 0.87, "depth_mae_mm": 0.0741, "energy_mj": 8.23},
    },
    "force": {
        "CPU": {"latency_ms": 2.30, "force_z_mae_n": 0.0668, "energy_mj": 74.15},
        "GPU": {"latency_ms": 0.36, "force_z_mae_n": 0.0668, "energy_mj": 11.01},
        "FPGA": {"latency_ms": 0.11, "force_z_mae_n": 0.0668, "energy_mj": 0.18},
    },
    "image_to_force": {
        "CPU": {"latency_ms": 6.82, "force_z_mae_n": 0.0669, "energy_mj": 238.05},
        "GPU": {"latency_ms": 3.26, "force_z_mae_n": 0.0667, "energy_mj": 33.60},
        "FPGA": {"latency_ms": 1.09, "force_z_mae_n": 0.0679, "energy_mj": 8.41},
    },
}
"""Supplement, table of 128×128 inputs: AMD Ryzen 7 8845H, NVIDIA RTX 4060 Laptop, XCZU19EG."""
EDGE = {
    "image_to_force_ms": STAGES["image_to_force"]["FPGA"]["latency_ms"],
    "image_to_force_cycles_at_150_mhz": 163_500,
    "normals_ms": STAGES["normals"]["FPGA"]["latency_ms"],
    "depth_ms": STAGES["depth"]["FPGA"]["latency_ms"],
    "force_ms": STAGES["force"]["FPGA"]["latency_ms"],
    "float": {
        "gradient_mae_mm_per_px": STAGES["normals"]["CPU"]["gradient_mae_mm_per_px"],
        "depth_mae_mm": STAGES["depth"]["CPU"]["depth_mae_mm"],
        "force_mae_n": STAGES["force"]["CPU"]["force_z_mae_n"],
    },
    "integer": {
        "gradient_mae_mm_per_px": STAGES["normals"]["FPGA"]["gradient_mae_mm_per_px"],
        "depth_mae_mm": STAGES["depth"]["FPGA"]["depth_mae_mm"],
        "force_mae_n": STAGES["image_to_force"]["FPGA"]["force_z_mae_n"],
    },
}
"""What `fastac build` prints beside its own: the board's times, and errors in floats and in integers."""
