; The floating-point status, saved and put back: branch-free code raises flags that mean nothing.

declare void @llvm.x86.sse.stmxcsr(ptr)
declare void @llvm.x86.sse.ldmxcsr(ptr)

define internal i64 @saved_status() {
  %room = alloca i32, align 4
  call void @llvm.x86.sse.stmxcsr(ptr %room)
  %status = load volatile i32, ptr %room
  %wide = zext i32 %status to i64
  ret i64 %wide
}

define internal void @put_back(i64 %wide) {
  %room = alloca i32, align 4
  %status = trunc i64 %wide to i32
  store volatile i32 %status, ptr %room
  call void @llvm.x86.sse.ldmxcsr(ptr %room)
  ret void
}
