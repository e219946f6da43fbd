; The floating-point status, saved and put back: branch-free code raises flags that mean nothing.

declare i64 @llvm.aarch64.get.fpsr()
declare void @llvm.aarch64.set.fpsr(i64)

define internal i64 @saved_status() {
  %status = call i64 @llvm.aarch64.get.fpsr()
  ret i64 %status
}

define internal void @put_back(i64 %status) {
  call void @llvm.aarch64.set.fpsr(i64 %status)
  ret void
}
