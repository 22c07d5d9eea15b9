# Reports of an open, routed design, and the checks that it must pass. build.tcl sources this.

# pattern: of the core's cell in the netlist, "" where the core is the whole design.
proc write_reports {output saif pattern} {
    report_utilization -file [file join $output utilization.rpt]
    report_utilization -hierarchical -file [file join $output utilization_hierarchical.rpt]
    report_timing_summary -max_paths 10 -report_unconstrained -file [file join $output timing.rpt]
    report_route_status -file [file join $output route_status.rpt]
    report_drc -file [file join $output drc.rpt]
    report_methodology -file [file join $output methodology.rpt]
    if {[file exists $saif]} {
        read_activity $output $saif $pattern
    } else {
        puts "No activity in $saif: the power is of Vivado's own assumptions."
    }
    report_power -file [file join $output power.rpt]
}

# The simulated activity of the core's nets; those that Vivado does not find are listed in a file.
proc read_activity {output saif pattern} {
    if {$pattern ne ""} {
        set cells [get_cells -quiet -hierarchical -filter "NAME =~ $pattern"]
        if {[llength $cells] != 1} {
            error "cells $pattern: [llength $cells] in the netlist: expected 1, to read $saif into"
        }
        current_instance [lindex $cells 0]
    }
    read_saif -strip_path fastac -out_file [file join $output saif_unmatched.txt] $saif
    if {$pattern ne ""} {
        current_instance
    }
}

# Out of context nothing drives the clock's port: its delays are counted from a clock buffer's site.
proc set_clock_source {port} {
    foreach type {BUFGCE BUFGCTRL} {
        set sites [lsort -dictionary [get_sites -quiet -filter "SITE_TYPE == $type"]]
        if {[llength $sites]} {
            set_property HD.CLK_SRC [lindex $sites 0] [get_ports $port]
            return
        }
    }
    error "port $port: the device has no site of a clock buffer"
}

proc check_routing {} {
    foreach condition {PLACED_FULLY ROUTED_FULLY} {
        if {![report_route_status -boolean_check $condition]} {
            error "the design is not $condition: see route_status.rpt"
        }
    }
}

# The clock at the core's pin must be known, else no path inside the core is constrained.
proc check_clock {pattern clock_mhz} {
    set pins [get_pins -quiet -hierarchical -filter "NAME =~ $pattern"]
    set clocks [get_clocks -quiet -of_objects $pins]
    if {[llength $clocks] != 1} {
        error "pin $pattern: [llength $clocks] clocks: expected 1, that of the processing system"
    }
    set mhz [expr {1000.0 / [get_property PERIOD [lindex $clocks 0]]}]
    puts [format "Clock of the core: %.3f MHz; the scene's: %.3f MHz" $mhz $clock_mhz]
    if {abs($mhz - $clock_mhz) > 0.02 * $clock_mhz} {
        error [format "the core's clock is %.3f MHz: expected the scene's %.3f, within 2%%" $mhz $clock_mhz]
    }
}

# Setup and hold slack of the worst path of each kind must not be negative. Pulse widths are not checked: timing.rpt
# has them (WPWS).
proc check_slack {} {
    foreach {kind delay} {setup max hold min} {
        set path [get_timing_paths -delay_type $delay -max_paths 1 -nworst 1]
        if {![llength $path]} {
            error "$kind: no timing path: the clock is not constrained"
        }
        set slack [get_property SLACK [lindex $path 0]]
        puts [format "Worst slack, %s: %.3f ns" $kind $slack]
        if {$slack < 0} {
            error [format "%s slack %.3f ns is negative: timing is not met, see timing.rpt" $kind $slack]
        }
    }
}
