; The inner loop of every numpy function of kernels:
;
;   void inner_loop(char **args, const int64_t *dims, const int64_t *steps, const Layout *layout)
;
; numpy gives in args the first row of each operand, in dims[0] the number of rows, in steps first the
; distance in bytes between rows of each operand, then the strides within a row, operand by operand and
; axis by axis. The layout says which kernel to call and what a row looks like:
;
;   0 scalar   a kernel(pointers, steps, rows) for one row
;   1 wide     the same for many rows
;   2 operands (the output is the last)
;   3 axes     of all operands together
;   4 numbers  of a row of all operands together
;   5 axes_of  number of axes of each operand: int64[operands]
;   6 extents  int64[axes]
;   7 expected strides of contiguous rows: int64[axes]
;   8 sizes    numbers in a row of each operand: int64[operands]
;
; Rows that are not contiguous go through a buffer, eight at a time. saved_status and put_back stand in
; a file for each kind of processor.

%Layout = type { ptr, ptr, i64, i64, i64, ptr, ptr, ptr, ptr }

define internal ptr @kernel_for(ptr %layout, i64 %rows) {
  %single = icmp eq i64 %rows, 1
  %field = select i1 %single, i64 0, i64 8
  %at = getelementptr i8, ptr %layout, i64 %field
  %kernel = load ptr, ptr %at
  ret ptr %kernel
}

define void @inner_loop(ptr %args, ptr %dims, ptr %steps, ptr %layout) {
entry:
  %rows = load i64, ptr %dims
  %some = icmp sgt i64 %rows, 0
  br i1 %some, label %look, label %nothing
look:
  %status = call i64 @saved_status()
  %operands.at = getelementptr %Layout, ptr %layout, i64 0, i32 2
  %operands = load i64, ptr %operands.at
  %axes.at = getelementptr %Layout, ptr %layout, i64 0, i32 3
  %axes = load i64, ptr %axes.at
  %extents.at = getelementptr %Layout, ptr %layout, i64 0, i32 6
  %extents = load ptr, ptr %extents.at
  %expected.at = getelementptr %Layout, ptr %layout, i64 0, i32 7
  %expected = load ptr, ptr %expected.at
  %strides = getelementptr i64, ptr %steps, i64 %operands
  br label %axis
axis:                                             ; are all rows contiguous?
  %a = phi i64 [0, %look], [%a.next, %axis.next]
  %a.left = icmp slt i64 %a, %axes
  br i1 %a.left, label %axis.test, label %direct
axis.test:
  %stride.at = getelementptr i64, ptr %strides, i64 %a
  %stride = load i64, ptr %stride.at
  %wanted.at = getelementptr i64, ptr %expected, i64 %a
  %wanted = load i64, ptr %wanted.at
  %extent.at = getelementptr i64, ptr %extents, i64 %a
  %extent = load i64, ptr %extent.at
  %same = icmp eq i64 %stride, %wanted
  %alone = icmp eq i64 %extent, 1                 ; the stride of a single number means nothing
  %fine = or i1 %same, %alone
  br i1 %fine, label %axis.next, label %buffered
axis.next:
  %a.next = add i64 %a, 1
  br label %axis
direct:
  %kernel = call ptr @kernel_for(ptr %layout, i64 %rows)
  call void %kernel(ptr %args, ptr %steps, i64 %rows)
  br label %exit
buffered:
  call void @buffered_loop(ptr %args, i64 %rows, ptr %steps, ptr %layout)
  br label %exit
exit:
  call void @put_back(i64 %status)
  ret void
nothing:
  ret void
}

define internal void @buffered_loop(ptr %args, i64 %rows, ptr %steps, ptr %layout) noinline {
entry:
  %operands.at = getelementptr %Layout, ptr %layout, i64 0, i32 2
  %operands = load i64, ptr %operands.at
  %numbers.at = getelementptr %Layout, ptr %layout, i64 0, i32 4
  %numbers = load i64, ptr %numbers.at
  %axes_of.at = getelementptr %Layout, ptr %layout, i64 0, i32 5
  %axes_of = load ptr, ptr %axes_of.at
  %extents.at = getelementptr %Layout, ptr %layout, i64 0, i32 6
  %extents = load ptr, ptr %extents.at
  %sizes.at = getelementptr %Layout, ptr %layout, i64 0, i32 8
  %sizes = load ptr, ptr %sizes.at
  %strides = getelementptr i64, ptr %steps, i64 %operands
  %last = sub i64 %operands, 1
  %offsets = alloca i64, i64 %numbers, align 64   ; of each number from the start of its row
  %room = mul i64 %numbers, 8
  %buffer = alloca double, i64 %room, align 64
  %pointers = alloca ptr, i64 %operands, align 64
  %packed = alloca i64, i64 %operands, align 64
  br label %operand

operand:                                          ; where each number of each operand stands
  %o = phi i64 [0, %entry], [%o.next, %operand.next]
  %o.axis = phi i64 [0, %entry], [%o.axis.next, %operand.next]
  %o.number = phi i64 [0, %entry], [%o.number.next, %operand.next]
  %o.left = icmp slt i64 %o, %operands
  br i1 %o.left, label %operand.do, label %block
operand.do:
  %size.at = getelementptr i64, ptr %sizes, i64 %o
  %size = load i64, ptr %size.at
  %rank.at = getelementptr i64, ptr %axes_of, i64 %o
  %rank = load i64, ptr %rank.at
  %shift = mul i64 %o.number, 8
  %own = getelementptr double, ptr %buffer, i64 %shift
  %pointer.at = getelementptr ptr, ptr %pointers, i64 %o
  store ptr %own, ptr %pointer.at
  %bytes = mul i64 %size, 8
  %packed.at = getelementptr i64, ptr %packed, i64 %o
  store i64 %bytes, ptr %packed.at
  %o.axis.next = add i64 %o.axis, %rank
  br label %number
number:
  %n = phi i64 [0, %operand.do], [%n.next, %number.done]
  %n.left = icmp slt i64 %n, %size
  br i1 %n.left, label %digit, label %operand.next
digit:                                            ; the index along each axis, the last axis first
  %d = phi i64 [%o.axis.next, %number], [%d.next, %digit.do]
  %rest = phi i64 [%n, %number], [%rest.next, %digit.do]
  %offset = phi i64 [0, %number], [%offset.next, %digit.do]
  %d.left = icmp sgt i64 %d, %o.axis
  br i1 %d.left, label %digit.do, label %number.done
digit.do:
  %d.next = sub i64 %d, 1
  %extent.at = getelementptr i64, ptr %extents, i64 %d.next
  %extent = load i64, ptr %extent.at
  %stride.at = getelementptr i64, ptr %strides, i64 %d.next
  %stride = load i64, ptr %stride.at
  %index = urem i64 %rest, %extent
  %rest.next = udiv i64 %rest, %extent
  %along = mul i64 %index, %stride
  %offset.next = add i64 %offset, %along
  br label %digit
number.done:
  %place = add i64 %o.number, %n
  %place.at = getelementptr i64, ptr %offsets, i64 %place
  store i64 %offset, ptr %place.at
  %n.next = add i64 %n, 1
  br label %number
operand.next:
  %o.next = add i64 %o, 1
  %o.number.next = add i64 %o.number, %size
  br label %operand

block:                                            ; eight rows at a time
  %first = phi i64 [0, %operand], [%first.next, %block.done]
  %b.left = icmp slt i64 %first, %rows
  br i1 %b.left, label %block.do, label %exit
block.do:
  %remaining = sub i64 %rows, %first
  %few = icmp slt i64 %remaining, 8
  %count = select i1 %few, i64 %remaining, i64 8
  call void @copy_rows(i1 true, i64 0, i64 %last, ptr %args, ptr %steps, i64 %first, i64 %count, ptr %sizes, ptr %offsets, ptr %buffer)
  %kernel = call ptr @kernel_for(ptr %layout, i64 %count)
  call void %kernel(ptr %pointers, ptr %packed, i64 %count)
  call void @copy_rows(i1 false, i64 %last, i64 %operands, ptr %args, ptr %steps, i64 %first, i64 %count, ptr %sizes, ptr %offsets, ptr %buffer)
  br label %block.done
block.done:
  %first.next = add i64 %first, 8
  br label %block
exit:
  ret void
}

; Rows of the operands from %begin to %end into the buffer (%in) or out of it.
define internal void @copy_rows(i1 %in, i64 %begin, i64 %end, ptr %args, ptr %steps, i64 %first, i64 %count, ptr %sizes, ptr %offsets, ptr %buffer) noinline {
entry:
  br label %operand
operand:
  %o = phi i64 [0, %entry], [%o.next, %operand.next]
  %o.number = phi i64 [0, %entry], [%o.number.next, %operand.next]
  %o.left = icmp slt i64 %o, %end
  br i1 %o.left, label %operand.do, label %exit
operand.do:
  %size.at = getelementptr i64, ptr %sizes, i64 %o
  %size = load i64, ptr %size.at
  %o.number.next = add i64 %o.number, %size
  %early = icmp slt i64 %o, %begin
  br i1 %early, label %operand.next, label %operand.copy
operand.copy:
  %arg.at = getelementptr ptr, ptr %args, i64 %o
  %arg = load ptr, ptr %arg.at
  %step.at = getelementptr i64, ptr %steps, i64 %o
  %step = load i64, ptr %step.at
  %start = mul i64 %o.number, 8
  %own = getelementptr double, ptr %buffer, i64 %start
  %places = getelementptr i64, ptr %offsets, i64 %o.number
  br label %row
row:
  %r = phi i64 [0, %operand.copy], [%r.next, %row.next]
  %r.left = icmp slt i64 %r, %count
  br i1 %r.left, label %row.do, label %operand.next
row.do:
  %index = add i64 %first, %r
  %shift = mul i64 %index, %step
  %outside.row = getelementptr i8, ptr %arg, i64 %shift
  %inside.shift = mul i64 %r, %size
  %inside.row = getelementptr double, ptr %own, i64 %inside.shift
  br label %number
number:
  %n = phi i64 [0, %row.do], [%n.next, %number.next]
  %n.left = icmp slt i64 %n, %size
  br i1 %n.left, label %number.do, label %row.next
number.do:
  %place.at = getelementptr i64, ptr %places, i64 %n
  %place = load i64, ptr %place.at
  %outside = getelementptr i8, ptr %outside.row, i64 %place
  %inside = getelementptr double, ptr %inside.row, i64 %n
  %source = select i1 %in, ptr %outside, ptr %inside
  %target = select i1 %in, ptr %inside, ptr %outside
  %value = load double, ptr %source, align 8
  store double %value, ptr %target, align 8
  br label %number.next
number.next:
  %n.next = add i64 %n, 1
  br label %number
row.next:
  %r.next = add i64 %r, 1
  br label %row
operand.next:
  %o.next = add i64 %o, 1
  br label %operand
exit:
  ret void
}
