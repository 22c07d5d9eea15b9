# From the folder that `fastac vivado` wrote to a bitstream:
#
#   vivado -mode batch -source build.tcl [-tclargs OPTION VALUE ...]
#
#   --board NAME    take the processing system's settings from another board's files; none: from no board's
#   --jobs N        runs at the same time (2)
#   --to STEP       stop after: design (block design, validated), synthesis, implementation, bitstream
#
# The project is made anew in project/. Reports and results come into output/. Any error, an unrouted net and
# a negative slack included, ends with exit status 1, and then there is no bitstream in output/.

set folder [file dirname [file normalize [info script]]]
source [file join $folder settings.tcl]
source [file join $folder checks.tcl]
source [file join $folder block_design.tcl]

set options [dict create --board $settings(board) --jobs 2 --to bitstream]
set steps {design synthesis implementation bitstream}

proc read_options {arguments} {
    global options steps
    foreach {name value} $arguments {
        if {![dict exists $options $name] || $value eq ""} {
            error "option $name $value: expected [join [dict keys $options] {, }], each with a value"
        }
        dict set options $name $value
    }
    if {[dict get $options --to] ni $steps} {
        error "option --to [dict get $options --to]: expected [join $steps {, }]"
    }
}

proc wanted {step} {
    global options steps
    return [expr {[lsearch $steps $step] <= [lsearch $steps [dict get $options --to]]}]
}

# The newest board files of that name; the part must be the one that the hardware was made for.
proc choose_board {} {
    global options settings boards
    set name [dict get $options --board]
    if {$name eq "none"} {
        puts "No board's files: the processing system keeps Vivado's defaults, or processing_system.tcl sets it."
        return
    }
    if {![dict exists $boards $name]} {
        error "board $name: expected, with the part $settings(part), one of [join [list none {*}[dict keys $boards]] {, }]"
    }
    set pattern [dict get $boards $name]
    set found [lindex [lsort -dictionary [get_board_parts -quiet -latest_file_version $pattern]] end]
    if {$found eq ""} {
        error "board $name: Vivado has no board files $pattern: install them (Tools, Vivado Store, Boards),\
            or go on without by -tclargs --board none"
    }
    set part [get_property PART_NAME $found]
    if {[string tolower $part] ne [string tolower $settings(part)]} {
        error "board $name: its part is $part, the hardware was made for $settings(part)"
    }
    set_property BOARD_PART $found [current_project]
    puts "Board: $found"
}

proc run_to {run step} {
    global options
    if {$step eq ""} {
        launch_runs $run -jobs [dict get $options --jobs]
    } else {
        launch_runs $run -to_step $step -jobs [dict get $options --jobs]
    }
    # Vivado before 2021.2 has wait_on_run only.
    if {[llength [info commands wait_on_runs]]} {
        wait_on_runs $run
    } else {
        wait_on_run $run
    }
    set status [get_property STATUS [get_runs $run]]
    if {![string match "*Complete*" $status] || [string match -nocase "*error*" $status]} {
        error "$run: $status: see project/fastac.runs/$run/runme.log"
    }
}

# The bitstream in the forms that Linux's FPGA manager, PYNQ and JTAG take, and the .xsa for other tools.
proc collect_results {output} {
    global settings
    set directory [get_property DIRECTORY [get_runs impl_1]]
    file copy -force [file join $directory system_wrapper.bit] [file join $output fastac.bit]
    file copy -force [file join $directory system_wrapper.bin] [file join $output fastac.bin]
    set handoff [get_property DIRECTORY [current_project]]
    set found [glob -nocomplain -directory $handoff fastac.gen/sources_1/bd/system/hw_handoff/system.hwh \
        fastac.srcs/sources_1/bd/system/hw_handoff/system.hwh]
    if {![llength $found]} {
        error "$handoff: no system.hwh, which PYNQ needs"
    }
    file copy -force [lindex $found 0] [file join $output fastac.hwh]
    write_hw_platform -fixed -include_bit -force [file join $output fastac.xsa]
    set description [open [file join $output fastac.bif] w]
    puts $description "all: { \[destination_device = pl\] fastac.bit }"
    close $description
    set arch [dict get {zynquplus zynqmp zynq7000 zynq} $settings(family)]
    cd $output
    exec bootgen -arch $arch -image fastac.bif -process_bitstream bin -w >@ stdout 2>@ stderr
}

proc build {} {
    global folder settings options argv
    read_options $argv
    set output [file join $folder output]
    file delete -force $output
    file mkdir $output
    create_project -force -part $settings(part) fastac [file join $folder project]
    choose_board
    set_property IP_REPO_PATHS [list [file join $folder ip]] [current_project]
    update_ip_catalog

    set design [make_block_design $folder]
    make_wrapper -top [get_files $design]
    add_files -norecurse [glob -directory [get_property DIRECTORY [current_project]] \
        {fastac.{gen,srcs}/sources_1/bd/system/hdl/system_wrapper.v}]
    set_property TOP system_wrapper [current_fileset]
    update_compile_order -fileset sources_1
    generate_target all [get_files $design]
    if {![wanted synthesis]} { return }

    run_to synth_1 ""
    open_run synth_1
    report_utilization -hierarchical -file [file join $output utilization_synth.rpt]
    close_design
    if {![wanted implementation]} { return }

    set_property STEPS.WRITE_BITSTREAM.ARGS.BIN_FILE true [get_runs impl_1]
    set_property STEPS.PHYS_OPT_DESIGN.IS_ENABLED true [get_runs impl_1]
    run_to impl_1 route_design
    open_run impl_1
    write_reports $output [file join $folder fastac.saif] "*/$settings(instance)/inst"
    check_routing
    check_clock "*/$settings(instance)/clk" $settings(clock_mhz)
    check_slack
    close_design
    if {![wanted bitstream]} { return }

    run_to impl_1 write_bitstream
    collect_results $output
}

if {[catch build message]} {
    puts stderr "fastac: $message"
    exit 1
}
puts "fastac: done: [file join $folder output]"
