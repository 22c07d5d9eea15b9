# The block design `system`: processing system, core, DMAs, interconnects, reset and interrupts.
#
# What differs between designs is in settings.tcl; what differs between the families is in `make_$family`.

proc add_ip {name instance} {
    return [create_bd_cell -type ip -vlnv xilinx.com:ip:$name $instance]
}

# Zynq MPSoC (PG201). The widths of the ports are those after a reset, so that the design can be loaded under a
# Linux whose boot loader does not know it.
proc make_zynquplus {clock_mhz own} {
    set ps [add_ip zynq_ultra_ps_e ps_0]
    set preset [expr {[get_property BOARD_PART [current_project]] ne ""}]
    apply_bd_automation -rule xilinx.com:bd_rule:zynq_ultra_ps_e \
        -config [list apply_board_preset $preset] $ps
    own_settings $ps $own
    set_property -dict [list \
        CONFIG.PSU__FPGA_PL0_ENABLE 1 \
        CONFIG.PSU__CRL_APB__PL0_REF_CTRL__FREQMHZ $clock_mhz \
        CONFIG.PSU__USE__FABRIC__RST 1 \
        CONFIG.PSU__USE__M_AXI_GP0 1 \
        CONFIG.PSU__MAXIGP0__DATA_WIDTH 128 \
        CONFIG.PSU__USE__M_AXI_GP1 0 \
        CONFIG.PSU__USE__M_AXI_GP2 0 \
        CONFIG.PSU__USE__S_AXI_GP2 1 \
        CONFIG.PSU__SAXIGP2__DATA_WIDTH $::settings(memory_port_bits) \
        CONFIG.PSU__USE__IRQ0 1] $ps
    return [dict create cell ps_0 clock ps_0/pl_clk0 reset ps_0/pl_resetn0 interrupt ps_0/pl_ps_irq0 \
        master ps_0/M_AXI_HPM0_FPD slave ps_0/S_AXI_HP0_FPD space ps_0/Data \
        memory {ps_0/SAXIGP2/HP0_DDR_LOW ps_0/SAXIGP2/HP0_DDR_HIGH} segments {ps_0/SAXIGP2/*} \
        clocks {ps_0/maxihpm0_fpd_aclk ps_0/saxihp0_fpd_aclk}]
}

# Zynq-7000 (PG082).
proc make_zynq7000 {clock_mhz own} {
    set ps [add_ip processing_system7 ps_0]
    set preset [expr {[get_property BOARD_PART [current_project]] ne ""}]
    apply_bd_automation -rule xilinx.com:bd_rule:processing_system7 \
        -config [list make_external "FIXED_IO, DDR" apply_board_preset $preset Master Disable Slave Disable] $ps
    own_settings $ps $own
    set_property -dict [list \
        CONFIG.PCW_EN_CLK0_PORT 1 \
        CONFIG.PCW_FPGA0_PERIPHERAL_FREQMHZ $clock_mhz \
        CONFIG.PCW_EN_RST0_PORT 1 \
        CONFIG.PCW_USE_M_AXI_GP0 1 \
        CONFIG.PCW_USE_S_AXI_HP0 1 \
        CONFIG.PCW_S_AXI_HP0_DATA_WIDTH $::settings(memory_port_bits) \
        CONFIG.PCW_USE_FABRIC_INTERRUPT 1 \
        CONFIG.PCW_IRQ_F2P_INTR 1] $ps
    return [dict create cell ps_0 clock ps_0/FCLK_CLK0 reset ps_0/FCLK_RESET0_N interrupt ps_0/IRQ_F2P \
        master ps_0/M_AXI_GP0 slave ps_0/S_AXI_HP0 space ps_0/Data \
        memory {ps_0/S_AXI_HP0/HP0_DDR_LOWOCM} segments {ps_0/S_AXI_HP0/*} \
        clocks {ps_0/M_AXI_GP0_ACLK ps_0/S_AXI_HP0_ACLK}]
}

# processing_system.tcl of the user, if there is one: its commands see the cell as $ps. What this design needs is set
# after it, so that a board's preset with other ports and clocks does for its memory and pins.
proc own_settings {ps file} {
    if {[file exists $file]} {
        puts "Settings of the processing system: $file"
        source $file
    }
}

proc clock_and_reset {ps instance clock_pin reset_pin} {
    connect_bd_net [get_bd_pins [dict get $ps clock]] [get_bd_pins $instance/$clock_pin]
    connect_bd_net [get_bd_pins reset_0/peripheral_aresetn] [get_bd_pins $instance/$reset_pin]
}

proc connect_interfaces {from to} {
    connect_bd_intf_net [get_bd_intf_pins $from] [get_bd_intf_pins $to]
}

# An AXI DMA in simple mode (PG021), with its streams and registers connected; `control` numbers the control
# interconnect's masters. Returns its masters towards memory, each with its address space.
proc add_dma {ps dma control} {
    dict with dma {
        set cell [add_ip axi_dma $instance]
        set sends [expr {$mm2s ne ""}]
        set properties [list \
            CONFIG.c_include_sg 0 \
            CONFIG.c_sg_include_stscntrl_strm 0 \
            CONFIG.c_sg_length_width $length_bits \
            CONFIG.c_addr_width $::settings(dma_address_bits) \
            CONFIG.c_include_mm2s $sends \
            CONFIG.c_include_s2mm 1 \
            CONFIG.c_include_s2mm_dre 0 \
            CONFIG.c_m_axi_s2mm_data_width $s2mm_memory_bits \
            CONFIG.c_s2mm_burst_size 16]
        if {$sends} {
            lappend properties \
                CONFIG.c_include_mm2s_dre 0 \
                CONFIG.c_m_axis_mm2s_tdata_width $mm2s_bits \
                CONFIG.c_m_axi_mm2s_data_width $mm2s_memory_bits \
                CONFIG.c_mm2s_burst_size 16
        }
        set_property -dict $properties $cell
        clock_and_reset $ps $instance s_axi_lite_aclk axi_resetn
        connect_interfaces control_0/[format M%02d_AXI $control] $instance/S_AXI_LITE
        connect_interfaces $::settings(instance)/$s2mm $instance/S_AXIS_S2MM
        connect_bd_net [get_bd_pins [dict get $ps clock]] [get_bd_pins $instance/m_axi_s2mm_aclk]
        set masters {}
        if {$sends} {
            connect_interfaces $instance/M_AXIS_MM2S $::settings(instance)/$mm2s
            connect_bd_net [get_bd_pins [dict get $ps clock]] [get_bd_pins $instance/m_axi_mm2s_aclk]
            lappend masters $instance/M_AXI_MM2S $instance/Data_MM2S
        }
        lappend masters $instance/M_AXI_S2MM $instance/Data_S2MM
        return $masters
    }
}

# Inputs of the concat in the order of `interrupts`, which drivers and the device tree count on.
proc connect_interrupts {ps interrupts} {
    set count [llength $interrupts]
    if {[llength [get_ipdefs -quiet -all xilinx.com:ip:xlconcat:*]]} {
        set cell [add_ip xlconcat interrupts_0]
    } else {
        # Vivado 2025 and later have it as inline HDL.
        set cell [create_bd_cell -type inline_hdl -vlnv xilinx.com:inline_hdl:ilconcat interrupts_0]
    }
    set_property CONFIG.NUM_PORTS $count $cell
    set line 0
    foreach pin $interrupts {
        connect_bd_net [get_bd_pins $pin] [get_bd_pins interrupts_0/In$line]
        incr line
    }
    connect_bd_net [get_bd_pins interrupts_0/dout] [get_bd_pins [dict get $ps interrupt]]
}

# Each DMA sees the processing system's DDR memory, as much of it as there is, and nothing else.
proc assign_memory {ps space} {
    set target [get_bd_addr_spaces $space]
    set found {}
    foreach pattern [dict get $ps memory] {
        lappend found {*}[get_bd_addr_segs -quiet $pattern]
    }
    if {![llength $found]} {
        error "$space: the processing system has no memory at [dict get $ps memory]"
    }
    foreach segment [get_bd_addr_segs -quiet [dict get $ps segments]] {
        if {$segment in $found} {
            assign_bd_address -target_address_space $target $segment
        } else {
            exclude_bd_addr_seg -quiet -target_address_space $target $segment
        }
    }
}

# Makes, validates and saves the design; returns its file's name.
proc make_block_design {folder} {
    global settings dmas interrupts
    create_bd_design system
    set ps [make_$settings(family) $settings(clock_mhz) [file join $folder processing_system.tcl]]
    set clock [get_bd_pins [dict get $ps clock]]

    add_ip proc_sys_reset reset_0
    connect_bd_net $clock [get_bd_pins reset_0/slowest_sync_clk]
    connect_bd_net [get_bd_pins [dict get $ps reset]] [get_bd_pins reset_0/ext_reset_in]
    foreach pin [dict get $ps clocks] {
        connect_bd_net $clock [get_bd_pins $pin]
    }

    create_bd_cell -type ip -vlnv $settings(vlnv) $settings(instance)
    connect_bd_net $clock [get_bd_pins $settings(instance)/clk]
    connect_bd_net [get_bd_pins reset_0/peripheral_reset] [get_bd_pins $settings(instance)/rst]

    set control [add_ip smartconnect control_0]
    set_property -dict [list CONFIG.NUM_SI 1 CONFIG.NUM_MI [expr {1 + [llength $dmas]}]] $control
    clock_and_reset $ps control_0 aclk aresetn
    connect_interfaces [dict get $ps master] control_0/S00_AXI
    connect_interfaces control_0/M00_AXI $settings(instance)/s_axil

    set masters {}
    set number 1
    foreach dma $dmas {
        lappend masters {*}[add_dma $ps $dma $number]
        incr number
    }
    set memory [add_ip smartconnect memory_0]
    set_property -dict [list CONFIG.NUM_SI [expr {[llength $masters] / 2}] CONFIG.NUM_MI 1] $memory
    clock_and_reset $ps memory_0 aclk aresetn
    connect_interfaces memory_0/M00_AXI [dict get $ps slave]
    set number 0
    foreach {master space} $masters {
        connect_interfaces $master memory_0/[format S%02d_AXI $number]
        incr number
    }
    connect_interrupts $ps $interrupts

    assign_bd_address -offset $settings(core_address) -range $settings(range) \
        -target_address_space [get_bd_addr_spaces [dict get $ps space]] \
        [get_bd_addr_segs $settings(instance)/s_axil/$settings(segment)]
    foreach dma $dmas {
        assign_bd_address -offset [dict get $dma address] -range $settings(range) \
            -target_address_space [get_bd_addr_spaces [dict get $ps space]] \
            [get_bd_addr_segs [dict get $dma instance]/S_AXI_LITE/Reg]
    }
    foreach {master space} $masters {
        assign_memory $ps $space
    }

    validate_bd_design
    save_bd_design
    return system.bd
}
