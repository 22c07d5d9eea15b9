"""Vivado's commands that our scripts use, with their options, as AMD's manual states them.

Source: Vivado Design Suite Tcl Command Reference Guide (UG835), the page of each command's name, section
"Syntax", of the releases 2020.2 to 2023.2; `create_bd_cell -type inline_hdl` is of 2026.1,
`get_bd_addr_spaces` of 2025.2. `READ` names the commands whose page was read for this table: all but
`get_bd_intf_pins`, whose page was not found, and which shares the line of `get_bd_pins` and its like. Some
options that our scripts do not use are left out.
"""

from typing import NamedTuple


class Command(NamedTuple):
    """options: each with whether a value follows; positional: least and largest number of arguments."""

    options: dict[str, bool]
    positional: tuple[int, int]


ANY = 1 << 30
QUERY = ("get_bd_cells", "get_bd_pins", "get_bd_intf_pins", "get_bd_addr_spaces", "get_bd_addr_segs")


def _command(flags: str, values: str, positional: tuple[int, int]) -> Command:
    options = dict.fromkeys(["quiet", "verbose", *flags.split()], False)
    return Command(options | dict.fromkeys(values.split(), True), positional)


COMMANDS = {
    # projects and files
    "create_project": _command("force in_memory ip rtl_kernel", "part", (0, 2)),
    "current_project": _command("", "", (0, 1)),
    "current_fileset": _command("constrset simset", "", (0, ANY)),
    "add_files": _command("norecurse scan_for_includes", "fileset of_objects copy_to", (0, ANY)),
    "get_files": _command("regexp nocase all references", "filter compile_order used_in of_objects", (0, 1)),
    "update_compile_order": _command("force_gui", "fileset", (0, 0)),
    "set_property": _command("", "dict name value objects", (0, 3)),
    "get_property": _command("min max", "", (2, 2)),
    "get_board_parts": _command("regexp nocase latest_file_version latest_hw_revision", "filter", (0, ANY)),
    "update_ip_catalog": _command(
        "rebuild update_module_ref", "add_ip delete_ip delete_mult_ip disable_ip repo_path", (0, 0)
    ),
    "get_ipdefs": _command("name regexp nocase all", "filter of_objects", (0, ANY)),
    # block designs
    "create_bd_design": _command("", "dir cell", (1, 1)),
    "create_bd_cell": _command("", "vlnv type reference revision", (1, 1)),
    "apply_bd_automation": _command("", "rule config dict opts", (0, ANY)),
    **dict.fromkeys(QUERY, _command("regexp hierarchical", "filter of_objects", (0, 1))),
    "connect_bd_net": _command("", "net boundary_type", (1, ANY)),
    "connect_bd_intf_net": _command("", "intf_net boundary_type", (2, 3)),
    "assign_bd_address": _command(
        "boundary master_boundary external force",
        "target_address_space dict offset range base_high",
        (0, ANY),
    ),
    "exclude_bd_addr_seg": _command("", "target_address_space", (0, 1)),
    "validate_bd_design": _command("force include_pfm", "design", (0, 0)),
    "save_bd_design": _command("", "", (0, 1)),
    "make_wrapper": _command("top testbench inst_template import force", "fileset", (1, 1)),
    "generate_target": _command("force", "", (2, 2)),
    # runs
    "launch_runs": _command("scripts_only next_step force", "jobs to_step dir host", (1, ANY)),
    "wait_on_runs": _command("", "timeout exit_condition", (1, ANY)),
    "get_runs": _command("regexp nocase", "filter", (0, 1)),
    "open_run": _command("", "name pr_config", (1, 1)),
    "close_design": _command("", "", (0, 0)),
    # without a project's runs
    "read_verilog": _command("sv", "library", (1, ANY)),
    "read_xdc": _command("unmanaged no_add quiet_diff_pairs", "mode cells ref", (1, 1)),
    "synth_design": _command("rtl", "name part constrset top mode flatten_hierarchy directive", (0, 0)),
    "opt_design": _command("retarget propconst sweep", "directive", (0, 0)),
    "place_design": _command("unplace post_place_opt timing_summary", "directive", (0, 0)),
    "phys_opt_design": _command("fanout_opt placement_opt", "directive", (0, 0)),
    "route_design": _command("unroute preserve tns_cleanup", "directive nets", (0, 0)),
    "write_checkpoint": _command("force", "cell", (0, 1)),
    # netlists, timing, reports
    "get_cells": _command("regexp nocase hierarchical", "hsc filter of_objects match_style", (0, 1)),
    "get_pins": _command("regexp nocase hierarchical leaf", "hsc filter of_objects match_style", (0, 1)),
    "get_ports": _command(
        "regexp nocase scoped_to_current_instance", "filter of_objects match_style", (0, 1)
    ),
    "get_clocks": _command("regexp nocase include_generated_clocks", "filter of_objects match_style", (0, 1)),
    "get_sites": _command("regexp nocase", "filter range of_objects", (0, 1)),
    "get_timing_paths": _command(
        "setup hold unique_pins no_report_unconstrained user_ignored routable_nets",
        "from to through delay_type max_paths nworst slack_lesser_than slack_greater_than group filter",
        (0, 0),
    ),
    "create_clock": _command("add", "period name waveform", (0, 1)),
    "all_outputs": _command("", "", (0, 0)),
    "set_max_delay": _command("rise fall reset_path datapath_only", "from to through", (1, 1)),
    "current_instance": _command("", "", (0, 1)),
    "read_saif": _command("no_strip", "strip_path out_file", (1, 1)),
    "report_utilization": _command(
        "append return_string slr packthru no_primitives omit_locs hierarchical hierarchical_percentages",
        "file pblocks cells name hierarchical_depth",
        (0, 0),
    ),
    "report_timing_summary": _command(
        "check_timing_verbose no_detailed_paths setup hold unique_pins report_unconstrained no_header append"
        " return_string warn_on_violation datasheet",
        "delay_type max_paths nworst path_type slack_lesser_than significant_digits file name cells rpx",
        (0, 0),
    ),
    "report_route_status": _command(
        "return_nets return_string append list_all_nets show_all dump_routes has_routing ignore_cache",
        "file of_objects route_type boolean_check",
        (0, 0),
    ),
    "report_drc": _command(
        "upgrade_cw append return_string no_waivers", "name checks ruledecks file rpx", (0, 0)
    ),
    "report_methodology": _command(
        "append return_string no_waivers", "name cells checks file rpx slack_lesser_than", (0, 0)
    ),
    "report_power": _command(
        "no_propagation vid advisory return_string append",
        "hier hierarchical_depth file name format xpe l rpx",
        (0, 0),
    ),
    "write_hw_platform": _command(
        "fixed force include_bit include_sim_content minimal hw hw_emu", "", (0, 1)
    ),
}
"""Every command of Vivado that a script of ours may call."""
READ = {
    *("create_project", "current_project", "current_fileset", "add_files", "get_files"),
    *("update_compile_order", "set_property", "get_property", "get_board_parts", "update_ip_catalog"),
    *("get_ipdefs", "create_bd_design", "create_bd_cell", "apply_bd_automation", "get_bd_cells"),
    *("get_bd_pins", "get_bd_addr_spaces", "get_bd_addr_segs", "connect_bd_net", "connect_bd_intf_net"),
    *("assign_bd_address", "exclude_bd_addr_seg", "validate_bd_design", "save_bd_design", "make_wrapper"),
    *("generate_target", "launch_runs", "wait_on_runs", "get_runs", "open_run", "close_design"),
    *("read_verilog", "read_xdc", "synth_design", "opt_design", "place_design", "phys_opt_design"),
    *("route_design", "write_checkpoint", "get_cells", "get_pins", "get_ports", "get_clocks", "get_sites"),
    *("get_timing_paths", "create_clock", "all_outputs", "set_max_delay", "current_instance", "read_saif"),
    *("report_utilization", "report_timing_summary", "report_route_status", "report_drc"),
    *("report_methodology", "report_power", "write_hw_platform"),
}
assert COMMANDS.keys() >= READ


def parsed(words: list[str]) -> tuple[str, dict[str, str], list[str]]:
    """Name, options (those without value: "1") and positional arguments of a call.

    Raises ValueError where the manual has no such option, a value is missing, or the number of arguments is
    wrong.
    """
    name, *rest = words
    command, options, positional = COMMANDS[name], {}, []
    while rest:
        given = rest.pop(0)
        option = given.removeprefix("-")
        negative_number = given[1:2].isdigit()
        if not given.startswith("-") or negative_number:
            positional.append(given)
            continue
        if option not in command.options:
            raise ValueError(f"{name}: unknown option {given}")
        if command.options[option] and not rest:
            raise ValueError(f"{name}: {given} lacks its value")
        options[option] = rest.pop(0) if command.options[option] else "1"
    low, high = command.positional
    if not low <= len(positional) <= high:
        raise ValueError(f"{name}: {len(positional)} arguments: expected {low} to {high}")
    return name, options, positional
