// SPDX-License-Identifier: Apache-2.0
#include "testing/simulation/fibers.hpp"

#include <linux/futex.h>
#include <sys/auxv.h>
#include <sys/syscall.h>

#include <cstddef>
#include <cstdlib>

#include "testing/simulation/real.hpp"

// Both functions save the registers that a function must keep, and the thread's pointer to its
// thread-local memory, on the stack. From then on the lending kernel thread uses that stack no
// more: it sleeps in system calls, which need none.
static_assert(offsetof(orbbuf::simulation::Fiber, is_lent) == 8);
static_assert(offsetof(orbbuf::simulation::Fiber, is_returned) == 12);

#if defined(__x86_64__)
/// Whether a program may set its thread pointer itself: a processor with FSGSBASE, and Linux 5.9
/// (HWCAP2_FSGSBASE). Elsewhere arch_prctl() sets it, which takes a system call each switch.
extern "C" __attribute__((visibility("hidden"))) const int orbbuf_has_fsgsbase =
    (::getauxval(AT_HWCAP2) & 2) != 0 && ::getenv("ORBBUF_NO_FSGSBASE") == nullptr ? 1 : 0;

asm(R"(
.macro orbbuf_save
  pushq %rbp
  pushq %rbx
  pushq %r12
  pushq %r13
  pushq %r14
  pushq %r15
  pushq %fs:0                   # the thread pointer, which points to itself
  movq %rsp, (%rdi)
.endm

.text
.type orbbuf_lend, @function
.globl orbbuf_lend
.hidden orbbuf_lend
orbbuf_lend:
  orbbuf_save
  movq %rdi, %r12
  movl $1, 8(%r12)
  leaq 8(%r12), %rdi
  movl $129, %esi               # FUTEX_WAKE, private
  movl $1, %edx
  movl $202, %eax
  syscall
1:
  leaq 12(%r12), %rdi
  movl $128, %esi               # FUTEX_WAIT, private
  xorl %edx, %edx
  xorl %r10d, %r10d
  movl $202, %eax
  syscall
  cmpl $0, 12(%r12)
  je 1b
  movq (%r12), %rsp
  jmp orbbuf_resume
.size orbbuf_lend, . - orbbuf_lend

.type orbbuf_switch, @function
.globl orbbuf_switch
.hidden orbbuf_switch
orbbuf_switch:
  orbbuf_save
  movq (%rsi), %rsp
orbbuf_resume:
  popq %rsi
  cmpl $0, orbbuf_has_fsgsbase(%rip)
  je 1f
  wrfsbase %rsi
  jmp 2f
1:
  movl $0x1002, %edi            # ARCH_SET_FS
  movl $158, %eax
  syscall                       # arch_prctl
2:
  popq %r15
  popq %r14
  popq %r13
  popq %r12
  popq %rbx
  popq %rbp
  ret
.size orbbuf_switch, . - orbbuf_switch
)");
#elif defined(__aarch64__)
asm(R"(
.macro orbbuf_save
  stp x29, x30, [sp, #-176]!
  stp x19, x20, [sp, #16]
  stp x21, x22, [sp, #32]
  stp x23, x24, [sp, #48]
  stp x25, x26, [sp, #64]
  stp x27, x28, [sp, #80]
  stp d8, d9, [sp, #96]
  stp d10, d11, [sp, #112]
  stp d12, d13, [sp, #128]
  stp d14, d15, [sp, #144]
  mrs x9, tpidr_el0
  str x9, [sp, #160]
  mov x9, sp
  str x9, [x0]
.endm

.text
.type orbbuf_lend, %function
.globl orbbuf_lend
.hidden orbbuf_lend
orbbuf_lend:
  orbbuf_save
  mov x19, x0
  add x0, x19, #8
  mov w9, #1
  stlr w9, [x0]
  mov x1, #129                  // FUTEX_WAKE, private
  mov x2, #1
  mov x8, #98
  svc #0
1:
  add x0, x19, #12
  mov x1, #128                  // FUTEX_WAIT, private
  mov x2, #0
  mov x3, #0
  mov x8, #98
  svc #0
  add x0, x19, #12
  ldar w9, [x0]
  cbz w9, 1b
  mov x1, x19
  b orbbuf_resume
.size orbbuf_lend, . - orbbuf_lend

.type orbbuf_switch, %function
.globl orbbuf_switch
.hidden orbbuf_switch
orbbuf_switch:
  orbbuf_save
orbbuf_resume:
  ldr x9, [x1]
  mov sp, x9
  ldr x9, [sp, #160]
  msr tpidr_el0, x9
  ldp d14, d15, [sp, #144]
  ldp d12, d13, [sp, #128]
  ldp d10, d11, [sp, #112]
  ldp d8, d9, [sp, #96]
  ldp x27, x28, [sp, #80]
  ldp x25, x26, [sp, #64]
  ldp x23, x24, [sp, #48]
  ldp x21, x22, [sp, #32]
  ldp x19, x20, [sp, #16]
  ldp x29, x30, [sp], #176
  ret
.size orbbuf_switch, . - orbbuf_switch
)");
#else
#error "the simulation runs on x86-64 and on 64-bit ARM"
#endif

namespace orbbuf::simulation {

void await_loan(Fiber& fiber) {
  while (__atomic_load_n(&fiber.is_lent, __ATOMIC_ACQUIRE) == 0) {
    raw_call(SYS_futex, reinterpret_cast<long>(&fiber.is_lent), FUTEX_WAIT_PRIVATE, 0);
  }
}

void give_back(Fiber& fiber) {
  __atomic_store_n(&fiber.is_returned, 1, __ATOMIC_RELEASE);
  raw_call(SYS_futex, reinterpret_cast<long>(&fiber.is_returned), FUTEX_WAKE_PRIVATE, 1);
}

}  // namespace orbbuf::simulation
