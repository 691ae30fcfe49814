"""A kernel with SocketCAN for one command, on any Linux machine.

command_line    options, choice of the backend, exit status
run_request     what is to be run, and the one error every backend raises
native          this kernel, in network and PID namespaces of its own
uml             user-mode Linux: a kernel that is an ordinary process
qemu            Debian's stock kernel in a virtual machine
guest_init      the shell scripts that are process 1 in the two guests
guest_session   output, time limits and status of a guest
kernel_modules  load order and contents of a kernel's modules
guardian        removes what a killed runner leaves behind
child_process   start, wait for and end the one child of the runner
"""
